"""How old a value is that came over a CAN bus: as its frame, or as what it is the answer to."""

from __future__ import annotations

import asyncio
import itertools
import os
import pty
import struct
import time
import tty
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from types import SimpleNamespace
from typing import Any

import can
import pytest

from abbe.drivers.can import incoming
from abbe.drivers.can.canopen.config import CanopenConfig
from abbe.drivers.can.canopen.link import CanopenLink
from abbe.drivers.can.dbc.config import DbcConfig
from abbe.drivers.can.dbc.link import DbcLink
from abbe.drivers.link import Quality
from tests.support.drivers.can.links import dbc_section, free_port
from tests.support.drivers.can.raw_peers import Node, peer
from tests.support.drivers.opening import until
from tests.support.drivers.serial.talker import Talker

pytestmark = pytest.mark.integration

PATIENCE = 60.0
LATE = 0.6
"""s that a late device takes, after it took its value."""
_CHANNELS = itertools.count()


def on_udp() -> dict[str, Any]:
    """An interface whose frames the kernel stamps."""
    options = {"port": free_port(), "hop_limit": 0, "fd": False}
    return {"interface": "udp_multicast", "channel": "239.74.163.88", "options": options}


def on_virtual() -> dict[str, Any]:
    """An interface without stamp and file descriptor."""
    return {"interface": "virtual", "channel": f"ages {next(_CHANNELS)}"}


@asynccontextmanager
async def dbc(settings: dict[str, Any], **parts: Any) -> AsyncIterator[DbcLink]:
    section = dbc_section(**parts) | settings
    link = DbcLink("bench", DbcConfig.model_validate(section))
    await link.open()
    try:
        yield link
    finally:
        await link.close()


@pytest.mark.parametrize("make", [on_udp, on_virtual])
async def test_a_requested_message_is_as_old_as_its_request(make: Any) -> None:
    settings = make()
    asked_for = {"POSITION_Z": {"request": {"id": 0x7F0, "data": "01"}, "within": PATIENCE}}

    def answer(one: Any, frame: can.Message) -> None:
        if frame.arbitration_id == 0x7F0:
            one.wait(LATE)
            one.send(0x203, struct.pack("<l", 5000))

    with peer(settings, answer) as device:
        channels = {"position_z": {"message": "POSITION_Z"}}
        async with dbc(settings, channels=channels, messages=asked_for, timeout=PATIENCE) as link:
            began = time.monotonic()
            sample = (await link.read(("position_z",)))["position_z"]
            assert sample.value == 5.0, sample.reason
            assert began <= sample.time <= max(at for at, _ in device.came)
            assert sample.age() >= LATE


@contextmanager
def positions(settings: dict[str, Any]) -> Iterator[Talker]:
    """POSITION comes every 20 ms; x is a number that counts up, in µm."""
    with peer(settings) as device:
        talker = Talker(lambda n: device.send(0x201, struct.pack("<ll", n, 0)), 0.02)
        try:
            yield talker
        finally:
            talker.close()


@contextmanager
def positions_on_slcan() -> Iterator[tuple[dict[str, Any], Talker]]:
    """The same over a serial adapter, which stamps nothing."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    settings = {
        "interface": "slcan", "channel": os.ttyname(slave), "bitrate": 500_000,
        "options": {"sleep_after_open": 0.0},
    }  # fmt: skip
    os.set_blocking(master, False)

    def send(number: int) -> None:
        os.write(master, b"t2018" + struct.pack("<ll", number, 0).hex().encode() + b"\r")

    talker = Talker(send, 0.02)
    try:
        yield settings, talker
    finally:
        talker.close()
        os.close(slave)
        os.close(master)


@pytest.mark.parametrize("kind", ["udp", "virtual", "slcan"])
async def test_frames_that_waited_for_us_are_not_fresh(kind: str) -> None:
    if kind == "slcan":
        with positions_on_slcan() as (settings, talker):
            await _watch(settings, talker)
    else:
        settings = on_udp() if kind == "udp" else on_virtual()
        with positions(settings) as talker:
            await _watch(settings, talker)


async def _watch(settings: dict[str, Any], talker: Talker) -> None:
    channels = {"x": {"message": "POSITION", "signal": "position_x", "scale": 1000.0}}
    patient = {"POSITION": {"within": PATIENCE}}
    async with dbc(settings, channels=channels, messages=patient) as link:

        async def read() -> float:
            sample = (await link.read(("x",)))["x"]
            assert sample.good, sample.reason
            # python's clock and the kernel's stamp are not read at once
            assert sample.time <= talker.began[round(sample.value)] + 0.02
            return sample.age()

        async def is_fresh() -> bool:
            return await read() < 0.1

        await until(is_fresh)
        for _ in range(3):
            time.sleep(0.7)  # noqa: ASYNC251 - the event loop is held up
            await read()
            await asyncio.sleep(0)
            await read()
            await until(is_fresh)


@pytest.mark.parametrize(
    ("set_by", "age"), [(0.0, 0.2), (-3600.0, 1.0), (3600.0, 1.0), (-0.1, 1.0)]
)
async def test_a_clock_that_was_set_makes_no_frame_younger(
    set_by: float, age: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It came 0.2 s ago, and 1 s ago nothing waited; then the clock was set."""
    shift = [0.0]
    clocks = SimpleNamespace(monotonic=time.monotonic, time=lambda: time.time() + shift[0])

    class Bus:
        def __init__(self) -> None:
            self.ends = os.pipe()

        def fileno(self) -> int:
            return self.ends[0]

        def recv(self, timeout: float | None) -> can.Message:
            return frame

    bus, came = Bus(), list[float]()
    with monkeypatch.context() as patched:
        patched.setattr(incoming, "time", clocks)
        taken = incoming.Incoming(
            bus,  # type: ignore[arg-type]
            stamped=True,
            name="clocks",
            since=time.monotonic() - 1.0,
            on_frame=lambda _, arrived, __: came.append(time.monotonic() - arrived),
            on_lost=pytest.fail,
        )
        frame = can.Message(timestamp=time.time() - 0.2, arbitration_id=1)
        shift[0] = set_by
        assert taken.wait(0.0)
    taken.close()
    for end in bus.ends:
        os.close(end)
    assert age - 1e-3 <= came[0] <= age + 0.5


# CANopen


@asynccontextmanager
async def canopen(
    settings: dict[str, Any], channels: dict[str, Any], **more: Any
) -> AsyncIterator[CanopenLink]:
    section = {
        "nodes": {"x": {"id": 3}}, "channels": channels, "timeout": PATIENCE,
        "reconnect_min": 0.02, "reconnect_max": 0.1,
    }  # fmt: skip
    link = CanopenLink("bench", CanopenConfig.model_validate(section | settings | more))
    await link.open()
    try:
        yield link
    finally:
        await link.close()


@pytest.mark.parametrize(("by", "sync"), [("sdo", None), ("pdo", "read")])
@pytest.mark.parametrize("make", [on_udp, on_virtual])
async def test_a_late_node_is_as_old_as_its_question(make: Any, by: str, sync: str | None) -> None:
    settings, node = make(), Node(3)
    x = {"x": {"node": "x", "profile": "cia406", "by": by}}
    with peer(settings, node.answer) as device:
        async with canopen(settings, x, sync=sync) as link:
            node.late, node.position = LATE, 7
            began = time.monotonic()
            sample = (await link.read(("x",)))["x"]
            assert sample.value == 7.0, sample.reason
            assert began <= sample.time <= device.came[-1][0]
            assert sample.age() >= LATE


@pytest.mark.parametrize("make", [on_udp, on_virtual])
async def test_a_prompt_node_is_understood_at_every_read(make: Any) -> None:
    """Its answer comes before anybody has looked again whether something waits."""
    settings, node = make(), Node(3)
    x = {"x": {"node": "x", "profile": "cia406", "by": "pdo"}}
    with peer(settings, node.answer):
        async with canopen(settings, x, sync="read") as link:
            for node.position in range(50):
                sample = (await link.read(("x",)))["x"]
                assert sample.value == node.position, sample.reason


async def test_a_pdo_is_as_old_as_its_sync() -> None:
    settings, node = on_udp(), Node(3)
    x = {"x": {"node": "x", "profile": "cia406", "by": "pdo", "within": PATIENCE}}
    node.late = 0.3
    with peer(settings, node.answer):
        async with canopen(settings, x, sync=1.0) as link:

            async def is_there() -> bool:
                return (await link.read(("x",)))["x"].good

            await until(is_there)
            for _ in range(2):
                node.position += 1

                async def has_followed() -> bool:
                    return (await link.read(("x",)))["x"].value == node.position

                await until(has_followed)
                assert (await link.read(("x",)))["x"].age() >= 0.3


async def test_a_brief_refusal_leaves_nothing_behind() -> None:
    settings, node = on_udp(), Node(3)
    x = {"x": {"node": "x", "profile": "cia406", "every": 30.0}}
    with peer(settings, node.answer):
        async with canopen(settings, x) as link:
            node.refuses = {0x6004}
            ends = time.monotonic() + 0.2
            while time.monotonic() < ends:
                assert (await link.read(("x",)))["x"].quality is Quality.BAD
            node.refuses = set()

            async def is_back() -> bool:
                return (await link.read(("x",)))["x"].good

            assert await until(is_back) < 5.0


async def test_what_a_node_refused_while_it_was_set_up_comes_back() -> None:
    """It boots, and refuses for a moment to say what its PDO carries."""
    settings, node = on_udp(), Node(3)
    node.refuses = {0x1800, 0x1A00}
    channels = {
        "x": {"node": "x", "profile": "cia406", "by": "pdo"},
        "y": {"node": "x", "index": 0x2000, "type": "int32"},
    }
    with peer(settings, node.answer):
        async with canopen(settings, channels, sync="read") as link:
            sample = (await link.read(("x",)))["x"]
            assert sample.quality is Quality.BAD
            assert "is in none of the node's TPDOs" in sample.reason
            node.refuses = set()

            async def is_back() -> bool:
                return (await link.read(("x",)))["x"].good

            await until(is_back)
            assert (await link.read(("y",)))["y"].good
            assert link.status.reconnects == 0
