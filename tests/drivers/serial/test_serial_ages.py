"""How old a value is that a serial line brought: as old as its question, or as its first byte."""

from __future__ import annotations

import asyncio
import time
from typing import Any

import pytest

from abbe.drivers.link import Quality
from tests.support.drivers.opening import until
from tests.support.drivers.serial.links import linked
from tests.support.drivers.serial.raw_device import raw_device, stand_still
from tests.support.drivers.serial.talker import Talker

pytestmark = pytest.mark.integration

ASKED: dict[str, Any] = {
    "messages": {"m": {"query": "R", "pattern": r"X(?P<x>[-+]\d+)"}},
    "channels": {"x": {"message": "m", "unit": "mm"}},
}
STREAMED: dict[str, Any] = {
    "messages": {"m": {"pattern": r"X(?P<x>[-+]\d+)", "within": 30.0}},
    "channels": {"x": {"message": "m", "unit": "mm"}},
}


async def test_an_answer_is_as_old_as_its_question() -> None:
    late = 0.6
    with raw_device(lambda _: [(late, "X+1\r\n")]) as device:
        async with linked(device.path, ASKED, timeout=30.0) as link:
            asked = time.monotonic()
            sample = (await link.read(("x",)))["x"]
            assert sample.good
            # the device took it when the question came, and waited before it said so
            assert asked <= sample.time <= device.lines[-1][0]
            assert sample.age() >= late


async def test_nothing_that_was_waiting_passes_for_an_answer() -> None:
    """More than one read takes in: unasked lines of long ago, then the answer."""
    reply = ["X+1\r\n"]
    with raw_device(lambda _: [(0.0, reply[0])]) as device:
        async with linked(device.path, ASKED, timeout=30.0) as link:
            assert (await link.read(("x",)))["x"].value == 1.0
            for _ in range(5):
                device.send("X+99\r\n" * 1500)
                reply[0] = "X+2\r\n"
                assert (await link.read(("x",)))["x"].value == 2.0


async def test_lines_that_waited_for_us_are_not_fresh() -> None:
    with raw_device() as device:
        talker = Talker(device.send_count, 0.02)
        try:
            async with linked(device.path, STREAMED, timeout=30.0) as link:
                seen: dict[float, float] = {}

                async def read() -> float:
                    sample = (await link.read(("x",)))["x"]
                    assert sample.good, sample.reason
                    assert sample.time <= talker.began[round(sample.value)]
                    seen[sample.value] = sample.time
                    return sample.age()

                async def is_fresh() -> bool:
                    return await read() < 0.1

                await until(is_fresh)
                for _ in range(3):
                    stand_still(0.7)
                    # whichever is taken in first: none of them is told to be younger than it is
                    await read()
                    await asyncio.sleep(0)
                    await read()
                    await until(is_fresh)
                assert len(seen) >= 4
        finally:
            talker.close()


async def test_a_line_is_as_old_as_its_first_byte() -> None:
    with raw_device() as device:
        talker = Talker(device.send_count, 0.02)
        async with linked(device.path, STREAMED) as link:
            talker.close()
            began = time.monotonic()
            device.send("X+1")
            await asyncio.sleep(0.5)
            device.send("000000\r\n")

            async def is_there() -> bool:
                return (await link.read(("x",)))["x"].value == 1e6

            await until(is_there)
            sample = (await link.read(("x",)))["x"]
            assert sample.time <= began
            assert sample.age() >= 0.5


async def test_what_came_before_a_stall_is_missing_when_it_is_too_old() -> None:
    parts = {"messages": {"m": {"pattern": r"X(?P<x>[-+]\d+)", "within": 0.5}}}
    with raw_device() as device:
        talker = Talker(device.send_count, 0.02)
        try:
            async with linked(device.path, STREAMED | parts) as link:

                async def is_good() -> bool:
                    return (await link.read(("x",)))["x"].good

                await until(is_good)
                talker.close()
                stand_still(1.0)
                sample = (await link.read(("x",)))["x"]
                assert sample.quality is Quality.UNAVAILABLE
        finally:
            talker.close()


async def test_a_brief_refusal_leaves_nothing_behind() -> None:
    """Asked for every half minute, refused for a moment: back at once, not half a minute later."""
    parts: dict[str, Any] = {
        "messages": ASKED["messages"]
        | {
            "T": {
                "query": "T", "pattern": r"T(?P<T>\d+|-+)", "refused": "ERR", "every": 30.0,
            }
        },
        "channels": ASKED["channels"] | {"T": {"message": "T", "unit": "degC"}},
    }  # fmt: skip
    for refusal in ("ERR\r\n", "T----\r\n"):
        state = ["T20\r\n"]

        def answer(line: str, state: list[str] = state) -> list[tuple[float, str]]:
            return [(0.0, state[0] if line == "T" else "X+1\r\n")]

        with raw_device(answer) as device:
            async with linked(device.path, parts, timeout=30.0) as link:
                state[0] = refusal
                bad = await link.read(("x", "T"))
                assert bad["x"].good
                assert bad["T"].quality is Quality.BAD
                ends = time.monotonic() + 0.2
                while time.monotonic() < ends:
                    assert not (await link.read(("T",)))["T"].good
                state[0] = "T20\r\n"

                async def is_back() -> bool:
                    return (await link.read(("T",)))["T"].good

                assert await until(is_back) < 5.0
                asked = len(device.got("T"))
                await link.read(("T",))
                assert len(device.got("T")) == asked
