"""Bus-off by a shorted bus: a simulated slcan adapter counts its errors and leaves the bus."""

from __future__ import annotations

import os
import select
import tty
from collections.abc import Callable

import pytest
import serial

from abbe.drivers.can.dbc.config import DbcConfig
from abbe.drivers.can.dbc.link import DbcLink
from abbe.drivers.can.error_frames import LEFT_THE_BUS
from abbe.drivers.can.slcan_port import BufferedPort
from abbe.drivers.can.slcan_status import understand
from abbe.drivers.link import LinkConfigError, LinkState, LinkStatus, Quality
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.drivers.can.canopen_links import AXES, BY_PDO, linked
from tests.support.drivers.can.links import CORRECTION, READ, all_good
from tests.support.drivers.can.links import linked as linked_by_dbc
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration

NODES = {axis: {"id": number} for axis, number in (("x", 3), ("y", 4), ("z", 5))}
ASKED = {"adapter_status": "usbtin"}
FOREVER = {"POSITION": {"within": 600.0}, "TEMPERATURES": {"within": 600.0}}


def down(status: LinkStatus, why: str) -> Callable[[], bool]:
    return lambda: status.state is LinkState.DOWN and why in status.detail


def come(port: BufferedPort) -> bytes:
    """What the port hands on of what was just written to the other end."""
    assert select.select([port], [], [], 30.0)[0]
    got = b""
    while select.select([port], [], [], 0.0)[0] or port.holds:
        got += port.read(64)
    return got


@pytest.mark.parametrize(("reports", "settings"), [("flags", ASKED), ("lines", {})])
async def test_bus_off_is_named_until_the_bus_is_mended(
    reports: str, settings: dict[str, str]
) -> None:
    with SimulatedProcess("can", "--reports", reports) as bus:
        async with linked(bus.ready, NODES, BY_PDO, sync="read", **settings) as link:
            await all_good(link, AXES)
            assert bus.order("adapter")["state"] == "active"
            bus.order("fault", shorted=True)
            # the SYNC of this read is what cannot be sent
            samples = await link.read(AXES)
            assert all(s.quality is Quality.UNAVAILABLE for s in samples.values())
            await until(down(link.status, LEFT_THE_BUS))
            assert "the adapter says: bus-off" in link.status.detail
            samples = await link.read(AXES)
            assert all("bus-off" in s.reason for s in samples.values())
            # opened again and again, in vain: it does not become mere silence
            tried = bus.order("adapter")["openings"] + 4
            await until(lambda: bus.order("adapter")["openings"] >= tried)
            assert LEFT_THE_BUS in link.status.detail
            bus.order("fault")
            await all_good(link, AXES)
            assert link.status.state is LinkState.UP
            assert link.status.reconnects == 1
            assert bus.order("adapter")["state"] == "active"


async def test_bus_off_by_a_frame_that_is_written() -> None:
    with SimulatedProcess("can", "--reports", "flags", "--frames", "0.02") as bus:
        settings = {"messages": FOREVER} | ASKED
        async with linked_by_dbc(bus.ready, READ | CORRECTION, **settings) as link:
            await all_good(link, tuple(READ))
            bus.order("fault", shorted=True)
            await link.write(dict.fromkeys(CORRECTION, 0.0))
            await until(down(link.status, LEFT_THE_BUS))
            assert not (await link.read(("x",)))["x"].good
            bus.order("fault")
            await all_good(link, tuple(READ))


async def test_who_only_listens_to_a_shorted_bus_is_error_passive() -> None:
    with SimulatedProcess("can", "--reports", "flags", "--frames", "0.02") as bus:
        async with linked_by_dbc(bus.ready, READ, messages=FOREVER, **ASKED) as link:
            bus.order("fault", shorted=True)
            await until(lambda: "the adapter says: error passive" in link.status.detail)
            assert link.status.state is LinkState.DEGRADED
            bus.order("fault")
            await until(lambda: link.status.state is LinkState.UP)


async def test_alone_on_the_bus_is_error_passive_and_never_bus_off() -> None:
    with SimulatedProcess("can", "--reports", "lines", "--frames", "0.02") as bus:
        async with linked_by_dbc(bus.ready, READ | CORRECTION, messages=FOREVER) as link:
            bus.order("fault", lonely=True)
            await link.write(dict.fromkeys(CORRECTION, 0.0))
            passive = "the adapter says: error passive, 0 receive and 128 transmit errors"
            await until(lambda: link.status.detail == passive)
            assert link.status.state is LinkState.DEGRADED
            bus.order("fault")
            # the frame is repeated until it comes through; each that does takes one error back
            await until(lambda: bus.order("report")["setpoints_taken"] == 1)
            for _ in range(40):
                await link.write(dict.fromkeys(CORRECTION, 0.0))
            await until(lambda: link.status.state is LinkState.UP)
            assert link.status.reconnects == 0


@pytest.mark.parametrize("reports", ["flags", "nothing"])
async def test_an_adapter_that_does_not_tell_its_flags(reports: str) -> None:
    with SimulatedProcess("can", "--reports", reports, "--frames", "0.02") as bus:
        async with linked_by_dbc(bus.ready, READ, messages=FOREVER, **ASKED) as link:
            if reports == "flags":
                bus.order("hung_adapter", hung=True)
            await until(down(link.status, "the adapter has not reported its status flags"))
            if reports == "flags":
                bus.order("hung_adapter", hung=False)
                await all_good(link, tuple(READ))


def test_only_serial_adapters_have_status_flags() -> None:
    section = {"interface": "virtual", "channel": "x", "dbc": "x", "channels": READ} | ASKED
    with pytest.raises(LinkConfigError, match="adapter_status is for slcan") as caught:
        DbcLink("bench", DbcConfig.model_validate(section))
    assert caught.value.field == ("adapter_status",)


@pytest.mark.parametrize(
    ("line", "dialect", "text", "bus_off"),
    [
        (b"F00", "usbtin", "", False),
        (b"F04", "usbtin", "errors reached the warning level", False),
        (b"FA4", "usbtin", "bus-off, status flags A4h", True),
        (b"Fa4", "lawicel", "error passive, errors on the bus", False),
        (b"F09", "lawicel", "its receive queue was full: frames were lost, data overrun", False),
        (b"F40", "lawicel", "", False),
        (b"sa057033", None, "", False),
        (b"sw096003", None, "errors reached the warning level, 96 receive and 3 transmit", False),
        (b"sb256256", None, "bus-off, 256 receive and 256 transmit errors", True),
    ],
)
def test_what_adapters_say(line: bytes, dialect: str, text: str, bus_off: bool) -> None:
    found = understand(line, dialect)  # type: ignore[arg-type]
    assert found is not None
    assert text in found.text
    assert bool(text) == bool(found.text)
    assert found.bus_off is bus_off


def test_flags_of_which_nobody_said_whose_they_are_say_nothing() -> None:
    assert understand(b"FA4", None) is None


def test_the_adapters_words_are_taken_out_from_between_the_frames() -> None:
    """However the bytes come in pieces; what looks alike within a frame stays."""
    said = b"z\rt1232F0F1\rF24\r\aF00\rT000000FF1F0\rsb000256\rt0000\rFzz\r"
    frames = b"z\rt1232F0F1\r\aT000000FF1F0\rt0000\rFzz\r"
    master, slave = os.openpty()
    tty.setraw(slave)
    try:
        with serial.Serial(os.ttyname(slave), timeout=0) as opened:
            port = BufferedPort(opened)
            for size in (1, 2, 3, 7, len(said)):
                reports: list[bytes] = []
                refused: list[bool] = []
                port.on_status = reports.append
                port.on_refused = lambda into=refused: into.append(True)  # type: ignore[misc]
                got = b""
                for at in range(0, len(said), size):
                    os.write(master, said[at : at + size])
                    got += come(port)
                assert got == frames
                assert reports == [b"F24", b"F00", b"sb000256"]
                assert refused == [True]
            os.write(master, b"?" * 3000)
            assert come(port) == b""
            os.write(master, b"\rt0000\r")
            assert come(port) == b"\rt0000\r"
    finally:
        os.close(master)
        os.close(slave)
