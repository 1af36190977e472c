"""Waiting for an answer: on the spot only where it pays, and never for long; else by the loop."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

import pytest

from abbe.drivers import reply_wait
from abbe.drivers.reply_wait import LONGEST, ReplyWait, is_there

LONG = 30.0


class Device:
    """Answers on the spot once it has been waited for so often, or by the event loop."""

    def __init__(self) -> None:
        self.answer: ReplyWait[int] = ReplyWait(self._wait)
        self.waits: list[float] = []
        self.ready = False
        self.holds = 0

    def _wait(self, seconds: float) -> bool:
        self.waits.append(seconds)
        if self.ready:
            self.answer.give(7)
            return True
        if self.holds:
            self.holds -= 1
            return True
        return False

    async def ask(self, answer_after: Callable[[], None] | None = None) -> int:
        self.answer.begin()
        if answer_after is not None:
            asyncio.get_running_loop().call_soon(answer_after)
        return await self.answer.get(LONG)

    async def answered_by_the_loop(self) -> None:
        """One question; the answer comes with the next turn of the loop."""
        self.waits.clear()
        assert await self.ask(lambda: self.answer.give(3)) == 3


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the machine does meanwhile: an answer within a minute came soon."""
    monkeypatch.setattr(reply_wait, "LONGEST", 60.0)
    monkeypatch.setattr(reply_wait, "IN_A_ROW", 600.0)


@pytest.mark.usefixtures("patient")
async def test_answers_that_come_soon_are_waited_for_on_the_spot() -> None:
    device = Device()
    await device.answered_by_the_loop()
    # nothing was known of it: only looked whether something is there already
    assert device.waits == [0.0]
    device.waits.clear()
    device.ready = True
    assert await device.ask() == 7
    assert len(device.waits) == 1
    assert device.waits[0] > 1.0


@pytest.mark.usefixtures("patient")
async def test_after_a_wait_in_vain_some_answers_must_come_soon_first() -> None:
    device = Device()
    await device.answered_by_the_loop()
    await device.answered_by_the_loop()
    assert device.waits[0] > 1.0  # in vain; that this answer came within a minute counts as one
    for _ in range(3):
        await device.answered_by_the_loop()
        assert device.waits == [0.0]
    await device.answered_by_the_loop()
    assert device.waits[0] > 1.0


@pytest.mark.usefixtures("patient")
async def test_answers_that_are_there_already_came_soon() -> None:
    device = Device()
    await device.answered_by_the_loop()
    await device.answered_by_the_loop()
    device.ready = True
    for _ in range(3):
        device.waits.clear()
        assert await device.ask() == 7
        assert device.waits == [0.0]
    device.waits.clear()
    assert await device.ask() == 7
    assert device.waits[0] > 1.0


async def test_slow_answers_are_never_waited_for_on_the_spot() -> None:
    device = Device()
    loop = asyncio.get_running_loop()
    for _ in range(5):
        device.waits.clear()
        device.answer.begin()
        loop.call_later(10.0 * LONGEST, device.answer.give, 3)
        assert await device.answer.get(LONG) == 3
        assert device.waits == [0.0]


async def test_the_event_loop_gets_its_turn_though_every_answer_is_there_at_once() -> None:
    """A task that asks without end does not keep others from running."""
    device = Device()
    ran = 0

    async def other() -> None:
        nonlocal ran
        while True:
            ran += 1
            await asyncio.sleep(0)

    task = asyncio.create_task(other())
    while device.answer._pause:
        await device.answered_by_the_loop()
    device.ready = True
    before, until, most = ran, time.monotonic() + 0.2, 0
    began = time.monotonic()
    while time.monotonic() < until or most < 3:
        assert await device.ask() == 7
        most += 1
        assert time.monotonic() - began < LONG
    assert ran - before > 2
    task.cancel()


async def test_what_only_streams_in_is_not_waited_for_without_end() -> None:
    """Frames of others keep coming, the answer does not: the loop gets its turn."""
    device = Device()
    device.holds = 10**9
    task = asyncio.create_task(device.ask())
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert not task.done()
    assert len(device.waits) == 8
    device.answer.give(5)
    assert await task == 5


async def test_errors_time_outs_and_what_comes_too_late() -> None:
    device = Device()
    device.answer.give(1)
    device.answer.fail(ValueError("nobody asked"))
    device.answer.begin()
    with pytest.raises(TimeoutError):
        await device.answer.get(0.02)
    device.answer.give(2)  # late: not the answer to what is asked next
    device.answer.begin()
    device.answer.fail(ConnectionError("gone"))
    with pytest.raises(ConnectionError, match="gone"):
        await device.answer.get(LONG)
    await device.answered_by_the_loop()


async def test_a_cancelled_wait_wants_nothing_any_more() -> None:
    device = Device()
    task = asyncio.create_task(device.ask())
    await asyncio.sleep(0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert not device.answer.waiting
    device.answer.give(9)
    await device.answered_by_the_loop()


def test_file_descriptors_beyond_what_select_knows_are_not_waited_for() -> None:
    assert not is_there(5000, 0.0)
    assert not is_there(-1, 0.0)
