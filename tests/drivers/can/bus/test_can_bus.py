"""The bus under the links: receive errors, full drivers, error frames, bus-off, CAN FD."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from typing import Any

import can
import pytest
from can.interfaces.udp_multicast import UdpMulticastBus
from can.interfaces.virtual import VirtualBus

from abbe.drivers.can import outgoing
from abbe.drivers.can.datagrams import Datagrams
from abbe.drivers.can.dbc.config import DbcConfig
from abbe.drivers.can.dbc.link import DbcLink
from abbe.drivers.can.error_frames import error_text
from abbe.drivers.link import LinkDownError, LinkError, LinkState, Quality, TooLateError
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.drivers.can.links import (
    CORRECTION,
    READ,
    all_good,
    dbc_section,
    free_port,
    interface,
    linked,
)
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration

GROUP = "239.74.163.87"


@pytest.fixture(scope="module")
def udp() -> Iterator[SimulatedProcess]:
    """The bus over python-can's udp_multicast, which carries error frames too."""
    with SimulatedProcess("can", "--udp", f"{GROUP}:{free_port()}", "--frames", "0.02") as process:
        yield process


@pytest.fixture
def own_bus() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("can", "--frames", "0.02") as process:
        yield process


# Error frames


async def test_error_frames_are_reported_and_bus_off_is_an_outage(udp: SimulatedProcess) -> None:
    async with linked(udp.ready, READ) as link:
        udp.order("error_frame", id=0x04, data="0010000000000000")
        await until(lambda: link.status.state is LinkState.DEGRADED)
        assert link.status.detail == "receive error passive"
        await all_good(link, ("x",))
        udp.order("error_frame", id=0x04, data="0040000000000000")
        await until(lambda: link.status.state is LinkState.UP)
        udp.order("error_frame", id=0x40, data="0000000000000000")
        seen: list[str] = []

        async def down() -> bool:
            if link.status.state is LinkState.DOWN:
                seen.append(link.status.detail)
            return link.status.reconnects == 1

        await until(down)
        assert "bus-off" in seen[0]
        assert link.status.state is LinkState.UP


@pytest.mark.parametrize(
    ("identifier", "data", "words"),
    [
        (0x40, "00", "bus-off"),
        (0x20, "00", "nobody acknowledges"),
        (0x01, "00", "transmission timed out"),
        (0x0C, "0008000000000000", "warning level, protocol violation"),
        (0x04, "0003", "frames were lost, transmit buffer overflow"),
        (0x100, "", "controller restarted"),
        (0x800, "", "error frame 0x800"),
    ],
)
def test_error_frames_in_words(identifier: int, data: str, words: str) -> None:
    assert words in error_text(identifier, bytes.fromhex(data))


# Errors while receiving


class Broken:
    """Makes receiving fail from some moment on."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, kind: type, method: str) -> None:
        self.now = False
        receive = getattr(kind, method)

        def failing(bus: Any, timeout: float | None) -> Any:
            if self.now:
                raise can.CanOperationError("the interface went down")
            return receive(bus, timeout)

        monkeypatch.setattr(kind, method, failing)


async def test_a_receive_error_is_an_outage_and_is_overcome(
    udp: SimulatedProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = Broken(monkeypatch, Datagrams, "recv")
    async with linked(udp.ready, READ) as link:
        await all_good(link, ("x",))
        broken.now = True
        await until(lambda: link.status.state is LinkState.DOWN)
        assert (await link.read(("x",)))["x"].quality is Quality.UNAVAILABLE
        broken.now = False
        await until(lambda: link.status.state is LinkState.UP)
        await all_good(link, ("x",))


async def test_python_can_s_notifier_would_die_silently(
    udp: SimulatedProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the test above guards against: the stock way to receive in asyncio."""
    broken = Broken(monkeypatch, UdpMulticastBus, "_recv_internal")
    complaints: list[dict[str, Any]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, what: complaints.append(what))
    frames: list[can.Message] = []
    section = interface(udp.ready)
    bus = can.Bus(
        interface=section["interface"],
        channel=section["channel"],
        ignore_config=True,
        **section["options"],
    )
    notifier = can.Notifier(bus, [frames.append], loop=asyncio.get_running_loop())
    try:
        await until(lambda: len(frames) > 3)
        broken.now = True
        await until(lambda: bool(complaints))
        frames.clear()
        await asyncio.sleep(0.2)
        assert not frames
        assert notifier.exception is None  # nobody is told
        assert not notifier.stopped
    finally:
        notifier.stop()
        bus.shutdown()


# A driver that takes no more


async def test_frames_wait_for_a_driver_that_is_full_and_none_is_lost(
    own_bus: SimulatedProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outgoing, "_PATIENCE", 60.0)
    pid = own_bus.ready["pid"]
    patient = {"POSITION": {"within": 60.0}}
    async with linked(own_bus.ready, {"x": READ["x"]} | CORRECTION, messages=patient) as link:
        os.kill(pid, signal.SIGSTOP)
        values, writes = dict.fromkeys(CORRECTION, 0.0), list[asyncio.Task[None]]()
        try:
            while not writes or not writes[-1].done() or not writes[-1].exception():
                life = {"life": len(writes) % 256}
                writes.append(asyncio.create_task(link.write(values | life)))
                await asyncio.sleep(0)
            with pytest.raises(LinkError, match="1000 frames wait to be sent"):
                await writes.pop()
        finally:
            os.kill(pid, signal.SIGCONT)
        taken = len(writes)
        assert taken > 1000
        await asyncio.gather(*writes)
        await until(lambda: own_bus.order("report")["setpoints_taken"] == taken)
        last = own_bus.order("report")["setpoints"]
        assert [bytes.fromhex(data)[6] for data in last] == [
            i % 256 for i in range(taken - 5, taken)
        ]
        assert link.status.reconnects == 0


async def test_what_waits_too_long_for_room_is_never_sent(
    own_bus: SimulatedProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outgoing, "_PATIENCE", 60.0)
    patient = {"POSITION": {"within": 60.0}}
    async with linked(own_bus.ready, {"x": READ["x"]} | CORRECTION, messages=patient) as link:
        old, new = dict.fromkeys(CORRECTION, 1.0), dict.fromkeys(CORRECTION, 0.0)
        with pytest.raises(TooLateError) as late:
            await link.write(old, until=time.monotonic() - 1e-3)
        assert late.value.untouched == set(CORRECTION)
        os.kill(own_bus.ready["pid"], signal.SIGSTOP)
        writes = list[asyncio.Task[None]]()
        try:
            waits = False
            while not waits:
                writes.append(asyncio.create_task(link.write(new)))
                # a write may take its time; one that waits for room never ends
                _, waits = await asyncio.wait({writes[-1]}, timeout=1.0)
            given_up = asyncio.create_task(link.write(old))
            await asyncio.sleep(0)
            given_up.cancel()
            with pytest.raises(TooLateError, match="too old before it could be sent") as late:
                await link.write(old, until=time.monotonic() + 0.1)
            assert late.value.untouched == set(CORRECTION)
        finally:
            os.kill(own_bus.ready["pid"], signal.SIGCONT)
        await asyncio.gather(*writes)
        await link.write(new)
        await until(lambda: own_bus.order("report")["setpoints_taken"] >= len(writes) + 1)
        assert own_bus.order("report")["setpoints_taken"] == len(writes) + 1


async def test_a_driver_that_stays_full_is_an_outage(own_bus: SimulatedProcess) -> None:
    pid = own_bus.ready["pid"]
    patient = {"POSITION": {"within": 60.0}}
    async with linked(own_bus.ready, {"x": READ["x"]} | CORRECTION, messages=patient) as link:
        os.kill(pid, signal.SIGSTOP)
        try:

            async def fill() -> None:
                while True:
                    await link.write(dict.fromkeys(CORRECTION, 0.0))
                    await asyncio.sleep(0.001)

            with pytest.raises(LinkDownError, match="no room for a frame|takes no more"):
                await fill()
        finally:
            os.kill(pid, signal.SIGCONT)
        await until(lambda: link.status.state is LinkState.UP)
        await all_good(link, ("x",))


# An interface without a file descriptor: received by a thread, sent by a thread


@asynccontextmanager
async def on_virtual(**settings: Any) -> AsyncIterator[tuple[DbcLink, can.BusABC]]:
    """A link on python-can's virtual bus, and somebody else there who sends TEMPERATURES."""
    section = dbc_section({"T_left": {"message": "TEMPERATURES"}}, **settings)
    section |= {"interface": "virtual", "channel": f"abbe-{time.monotonic_ns()}"}
    link = DbcLink("bench", DbcConfig.model_validate(section))
    with can.Bus(interface="virtual", channel=section["channel"], ignore_config=True) as other:

        async def send() -> None:
            for value in range(100_000):
                data = (value & 0x7FFF).to_bytes(2, "big") + bytes(4)
                other.send(can.Message(arbitration_id=0x202, data=data, is_extended_id=False))
                await asyncio.sleep(0.01)

        sending = asyncio.create_task(send(), name="somebody else")
        await link.open()
        try:
            yield link, other
        finally:
            sending.cancel()
            await link.close()


async def test_an_interface_that_has_no_file_descriptor() -> None:
    async with on_virtual() as (link, _):
        assert link.status.state is LinkState.UP, link.status.detail
        first = (await link.read(("T_left",)))["T_left"]

        async def moved() -> bool:
            return (await link.read(("T_left",)))["T_left"].value > first.value

        await until(moved)
        next(t for t in asyncio.all_tasks() if t.get_name() == "somebody else").cancel()
        await until(lambda: link.status.state is LinkState.DOWN)


async def test_error_frames_of_other_interfaces_are_not_interpreted() -> None:
    async with on_virtual() as (link, other):
        other.send(can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False))
        await until(lambda: link.status.state is LinkState.DEGRADED)
        assert link.status.detail == "the interface reports error frames"
        assert link.status.reconnects == 0


async def test_an_interface_that_says_itself_that_it_is_bus_off(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    state = [can.BusState.ACTIVE]
    monkeypatch.setattr(VirtualBus, "state", property(lambda bus: state[0]))
    async with on_virtual() as (link, _):
        assert link.status.state is LinkState.UP
        state[0] = can.BusState.ERROR
        await until(lambda: "bus-off: the controller has left the bus" in link.status.detail)
        state[0] = can.BusState.ACTIVE
        await until(lambda: link.status.state is LinkState.UP)
        await all_good(link, ("T_left",))
