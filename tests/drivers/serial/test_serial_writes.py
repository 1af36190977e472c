"""Commands that leave in time or not at all, and what is known of them when they fail."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path
from typing import Any

import pytest

from abbe.drivers.link import LinkConfigError, LinkError, LinkState, TooLateError
from abbe.drivers.serial.link import SerialLink
from tests.support.drivers.opening import until
from tests.support.drivers.serial.links import linked, section
from tests.support.drivers.serial.raw_device import raw_device

pytestmark = pytest.mark.integration

PARTS: dict[str, Any] = {
    "messages": {"m": {"query": "R", "pattern": r"X(?P<x>[-+]\d+)"}},
    "channels": {
        "x": {"message": "m"},
        "a": {"command": "A{value:+.1f}", "acknowledge": "OK", "refused": "ERR"},
        "b": {"command": "B{value:+.1f}", "acknowledge": "OK", "refused": "ERR"},
        "quiet": {"command": "Q{value:+.1f}"},
    },
}
XOFF, XON = "\x13", "\x11"


async def test_what_waits_for_its_turn_for_too_long_is_not_sent() -> None:
    wait = [0.0]
    with raw_device(lambda line: [(wait[0], "OK\r\n" if line[0] in "AB" else "X+1\r\n")]) as device:
        async with linked(device.path, PARTS, timeout=30.0) as link:
            wait[0] = 1.2
            slow = asyncio.create_task(link.read(("x",)))
            await until(lambda: len(device.got("R")) == 2)
            with pytest.raises(TooLateError, match="not written: a, quiet") as late:
                await link.write({"a": 1.0, "quiet": 2.0}, until=time.monotonic() + 0.1)
            assert late.value.untouched == {"a", "quiet"}
            assert (await slow)["x"].good
            # the first one in time, the second one too late
            with pytest.raises(TooLateError, match="not written: b: .*; written before: a") as late:
                await link.write({"a": 1.0, "b": 2.0}, until=time.monotonic() + 0.8)
            assert (late.value.written, late.value.untouched) == ({"a"}, {"b"})
            await link.read(("x",))
            assert [line for _, line in device.lines if line != "R"] == ["A+1.0"]


async def test_what_a_refused_command_leaves() -> None:
    with raw_device(
        lambda line: [(0.0, {"A": "OK", "B": "ERR", "R": "X+1"}[line[0]] + "\r\n")]
    ) as d:
        async with linked(d.path, PARTS, timeout=30.0) as link:
            with pytest.raises(LinkError) as refused:
                await link.write({"a": 1.0, "b": 2.0, "quiet": 3.0})
            assert refused.value.written == {"a"}
            assert refused.value.untouched == {"b", "quiet"}
            with pytest.raises(LinkError, match="not writable: x") as refused:
                await link.write({"a": 1.0, "x": 2.0})
            assert refused.value.untouched == {"a", "x"}
            await link.write({"a": 2.0})


async def test_what_a_silent_command_leaves_is_not_known() -> None:
    with raw_device(lambda line: [(0.0, "X+1\r\n")] if line == "R" else []) as device:
        async with linked(device.path, PARTS, timeout=0.1) as link:
            with pytest.raises(LinkError) as silent:
                await link.write({"a": 1.0, "b": 2.0})
            assert silent.value.written == set()
            assert silent.value.untouched == {"b"}


@pytest.mark.parametrize("name", ["a", "quiet"])
async def test_a_device_that_stops_us_does_not_get_old_values_later(name: str) -> None:
    with raw_device(lambda line: [(0.0, "OK\r\n" if line[0] in "AB" else "X+1\r\n")]) as device:
        async with linked(device.path, PARTS, timeout=0.2, flow="xonxoff") as link:
            await link.read(("x",))
            device.send(XOFF)
            await asyncio.sleep(0.3)
            with pytest.raises(LinkError, match="takes no more characters") as stopped:
                await link.write({name: 1.0, "b": 2.0})
            assert stopped.value.untouched == {"b"}
            await until(lambda: link.status.state is LinkState.DOWN)
            before = len(device.got("R"))
            device.send(XON)
            # what was left would come before the question by which it is up again
            await until(lambda: link.status.state is LinkState.UP)
            assert len(device.got("R")) > before
            assert [line for _, line in device.lines if line != "R"] == []


async def test_a_command_without_an_answer_is_given_up_at_its_end() -> None:
    with raw_device(lambda line: [(0.0, "X+1\r\n")] if line == "R" else []) as device:
        async with linked(device.path, PARTS, timeout=30.0, flow="xonxoff") as link:
            device.send(XOFF)
            await asyncio.sleep(0.3)
            began = time.monotonic()
            with pytest.raises(LinkError, match="takes no more characters"):
                await link.write({"quiet": 1.0}, until=began + 0.2)
            assert 0.2 <= time.monotonic() - began < 10.0


def test_where_channels_sit(tmp_path: Path) -> None:
    (tmp_path / "by-id").symlink_to("/dev/null")
    one = SerialLink("one", section("/dev/null", PARTS))
    other = SerialLink("other", section(str(tmp_path / "by-id"), PARTS))
    assert one.owns == other.owns == ("serial /dev/null",)
    (a,), (b,), (x,) = one.places("a"), other.places("b"), one.places("x")
    assert a.overlaps(other.places("a")[0])
    assert not a.overlaps(b)
    assert not a.overlaps(x)


def test_range_and_step_of_channels() -> None:
    channels = PARTS["channels"] | {
        "a": {"command": "A{value:+08.3f}", "scale": 10.0},
        "b": {"command": "B{value:d}", "scale": 0.5},
        "quiet": {"command": "Q{value}"},
        "x": {"message": "m", "base": 16, "bits": 16, "scale": 0.001},
    }
    link = SerialLink("bench", section("/dev/null", PARTS | {"channels": channels}))
    assert link.info("a").step == pytest.approx(0.01)
    assert link.info("b").step == 0.5
    assert link.info("quiet").step == 0.0
    x = link.info("x")
    assert (x.low, x.high, x.step) == pytest.approx((-32.768, 32.767, 0.001))
    assert link.info("a").high == float("inf")


def test_positions_and_their_number_are_of_one_line() -> None:
    parts = {
        "messages": {
            "m": {"query": "R", "pattern": r"X(?P<x>\d+) N(?P<n>\d+)"},
            "other": {"query": "N", "pattern": r"#(?P<o>\d+)"},
        },
        "channels": {"x": {"message": "m"}, "n": {"message": "m"}, "o": {"message": "other"}},
    }
    link = SerialLink("bench", section("/dev/null", parts))
    link.keep_together(("x", "n"), one_sample=True)
    link.keep_together(("x", "o"))
    with pytest.raises(LinkConfigError, match="x, o must be of one answer"):
        link.keep_together(("x", "o"), one_sample=True)
    with pytest.raises(LinkConfigError, match="no channel 'y'"):
        link.keep_together(("y",))
