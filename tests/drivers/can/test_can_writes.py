"""Objects and frames that leave in time or not at all, what is known of them, where they sit."""

from __future__ import annotations

import asyncio
import struct
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from abbe.drivers.can.canopen.config import CanopenConfig
from abbe.drivers.can.canopen.link import CanopenLink
from abbe.drivers.can.dbc.config import DbcConfig
from abbe.drivers.can.dbc.link import DbcLink
from abbe.drivers.link import LinkConfigError, LinkError, LinkProtocolError, TooLateError
from tests.support.drivers.can.links import CORRECTION, DBC, READ, free_port
from tests.support.drivers.can.raw_peers import Node, peer
from tests.support.drivers.opening import until

pytestmark = pytest.mark.integration

CHANNELS: dict[str, Any] = {
    "x": {"node": "x", "profile": "cia406"},
    "a": {"node": "x", "index": 0x6100, "type": "int16", "scale": 0.5, "writable": True},
    "b": {"node": "x", "index": 0x6101, "type": "int32", "writable": True, "verify": True},
}


def udp() -> dict[str, Any]:
    options = {"port": free_port(), "hop_limit": 0, "fd": False}
    return {"interface": "udp_multicast", "channel": "239.74.163.89", "options": options}


def canopen(settings: dict[str, Any], channels: dict[str, Any], **more: Any) -> CanopenLink:
    section = {"nodes": {"x": {"id": 3}}, "channels": channels, "timeout": 60.0}
    return CanopenLink("bench", CanopenConfig.model_validate(section | settings | more))


@asynccontextmanager
async def opened(link: CanopenLink) -> AsyncIterator[CanopenLink]:
    await link.open()
    try:
        yield link
    finally:
        await link.close()


async def test_an_object_that_waited_too_long_for_its_turn_is_not_written() -> None:
    settings, node = udp(), Node(3)
    node.objects |= {(0x6100, 0): bytes(2), (0x6101, 0): bytes(4)}
    with peer(settings, node.answer):
        async with opened(canopen(settings, CHANNELS)) as link:
            node.late = 1.2
            slow = asyncio.create_task(link.read(("x",)))
            await asyncio.sleep(0.1)
            with pytest.raises(TooLateError, match="not written: a, b") as late:
                await link.write({"a": 1.0, "b": 2.0}, until=time.monotonic() + 0.3)
            assert late.value.untouched == {"a", "b"}
            assert (await slow)["x"].good
            with pytest.raises(TooLateError, match="written before: a") as late:
                await link.write({"a": 3.0, "b": 2.0}, until=time.monotonic() + 0.8)
            assert (late.value.written, late.value.untouched) == ({"a"}, {"b"})
            node.late = 0.0
            assert (await link.read(("x",)))["x"].good
            assert node.objects[0x6100, 0] == struct.pack("<h", 6)
            assert node.objects[0x6101, 0] == bytes(4)


async def test_what_a_refused_object_leaves() -> None:
    settings, node = udp(), Node(3)
    node.objects |= {(0x6100, 0): bytes(2), (0x6101, 0): bytes(4)}
    node.refuses = {0x6101}
    with peer(settings, node.answer):
        async with opened(canopen(settings, CHANNELS)) as link:
            with pytest.raises(LinkProtocolError, match="refused") as refused:
                await link.write({"a": 1.0, "b": 2.0})
            assert (refused.value.written, refused.value.untouched) == ({"a"}, {"b"})
            with pytest.raises(LinkError, match="a: 40000 does not fit int16") as wrong:
                await link.write({"b": 2.0, "a": 20000.0})
            assert wrong.value.untouched == {"a", "b"}
            node.refuses = set()
            await link.write({"a": 1.0, "b": 2.0})


def test_where_objects_sit_and_what_they_can_hold() -> None:
    settings = {"interface": "socketcan", "channel": "can0"}
    one = canopen(settings, CHANNELS | {"same": {"node": "x", "index": 0x6004, "type": "int32"}})
    pdo = CHANNELS["x"] | {"by": "pdo"}
    other = canopen(settings, {"x": pdo, "y": CHANNELS["b"] | {"index": 0x6004, "type": "int32"}})
    assert one.owns == other.owns == ("can socketcan can0",)
    (x,), (same,), (b,) = one.places("x"), one.places("same"), one.places("b")
    assert x.overlaps(same)
    assert x.overlaps(other.places("x")[0])  # by PDO and by SDO it is the same object
    assert x.overlaps(other.places("y")[0])
    assert not x.overlaps(b)
    info = one.info("a")
    assert (info.low, info.high, info.step) == (-16384.0, 16383.5, 0.5)
    assert info.read_back
    assert one.info("x").high == 2.0**31 - 1


def test_what_answers_one_sync() -> None:
    settings = {"interface": "socketcan", "channel": "can0"}
    both: dict[str, Any] = {
        name: {"node": "x", "profile": "cia406", "by": by}
        for name, by in (("x", "pdo"), ("y", "pdo"), ("s", "sdo"))
    }
    at_read = canopen(settings, both, sync="read")
    at_read.keep_together(("x", "y"), one_sample=True)
    at_read.keep_together(("x", "s"))
    with pytest.raises(LinkConfigError, match="x, s must answer one SYNC.* found s by SDO"):
        at_read.keep_together(("x", "s"), one_sample=True)
    with pytest.raises(LinkConfigError, match="found sync = 0.01"):
        canopen(settings, both, sync=0.01).keep_together(("x", "y"), one_sample=True)


def dbc(channels: dict[str, Any], file: Path = DBC) -> DbcLink:
    section = {"interface": "socketcan", "channel": "can0", "dbc": str(file), "channels": channels}
    return DbcLink("bench", DbcConfig.model_validate(section))


def test_where_signals_sit_what_they_can_hold_and_what_goes_together() -> None:
    link = dbc(READ | CORRECTION)
    other = dbc({"back": {"message": "CORRECTION", "signal": "correction_x"}})
    (x,) = {place.space for place in link.places("x")}
    assert x == ("frame 201h",)

    def meet(mine: str, its: str, another: DbcLink = link) -> bool:
        return any(a.overlaps(b) for a in link.places(mine) for b in another.places(its))

    assert meet("position_y", "y_um")
    assert not meet("x", "position_y")
    assert not meet("T_left", "T_right")
    assert not meet("x", "correction_x")
    assert meet("correction_x", "back", other)
    assert not meet("correction_y", "back", other)
    assert link.goes_with("correction_x") == set(CORRECTION)
    assert link.goes_with("x") == {"x"}
    info = link.info("correction_x")
    assert (info.low, info.high) == (-3.0, 3.0)
    assert info.step == pytest.approx(1e-4)
    assert (link.info("life").low, link.info("life").high, link.info("life").step) == (0, 255, 1)
    position = link.info("y_um")
    assert (position.low, position.high) == pytest.approx((-2e9, 2e9))
    assert link.info("T_left").low == pytest.approx(-50.0)
    link.keep_together(("x", "position_y"), one_sample=True)
    link.keep_together(("x", "T_left"))
    with pytest.raises(LinkConfigError, match=r"one frame.*POSITION, TEMPERATURES"):
        link.keep_together(("x", "T_left"), one_sample=True)


PAGED = """VERSION ""

NS_ :

BS_:

BU_: Abbe Box

BO_ 7 PAGED: 8 Abbe
 SG_ page M : 0|8@1+ (1,0) [0|255] "" Box
 SG_ one m1 : 8|16@1+ (1,0) [0|0] "" Box
 SG_ two m2 : 8|16@1+ (1,0) [0|0] "" Box
 SG_ always : 24|8@1+ (1,0) [0|0] "" Box

BO_ 8 HEARD: 8 Box
 SG_ heard : 7|12@0+ (1,0) [0|0] "" Abbe
"""


async def test_one_page_of_a_multiplexed_message_is_written(tmp_path: Path) -> None:
    file = tmp_path / "paged.dbc"
    file.write_text(PAGED)
    written = {name: {"message": "PAGED", "writable": True} for name in ("one", "two", "always")}
    with pytest.raises(LinkConfigError, match="one, two, always stand on different pages"):
        dbc(written, file)
    two = {name: written[name] for name in ("two", "always")}
    link = dbc(two | {"heard": {"message": "HEARD"}}, file)
    assert {(p.first, p.end) for p in link.places("heard")} == {(0, 8), (12, 16)}
    (two_at,) = {place.space for place in link.places("two")}
    assert two_at == ("frame 7h", "page page 2")
    (one_at,) = {place.space for place in dbc({"one": written["one"]}, file).places("one")}
    assert one_at == ("frame 7h", "page page 1")
    sent: list[bytes] = []
    settings = udp()
    with peer(settings, lambda _, frame: sent.append(bytes(frame.data))):
        section = settings | {"dbc": str(file), "channels": two}
        talking = DbcLink("bench", DbcConfig.model_validate(section))
        await talking.open()
        try:
            await talking.write({"two": 0x1234, "always": 5})
            await until(lambda: bool(sent))
        finally:
            await talking.close()
    assert sent == [bytes([2, 0x34, 0x12, 5, 0, 0, 0, 0])]
