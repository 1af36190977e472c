"""The wait for a device's reply: for a moment on the spot where that pays, else by the event loop.

Giving the event loop its turn and being called back costs more than a device takes that answers
across a pseudo-terminal, loopback or a fast bus. Where the last answers came that soon, the next
one is waited for on the spot, which no device on a slow line ever meets. Nobody else runs
meanwhile; so it is bounded twice, for each request and for all that follow each other without a
turn of the event loop, of all links together (``docs/decisions/0022``).
"""

from __future__ import annotations

import asyncio
import select
import time
from collections.abc import Callable
from typing import Any, Generic, TypeVar
from weakref import WeakKeyDictionary

from abbe.drivers.wait_limit import WaitLimit

T = TypeVar("T")

LONGEST = 0.75e-3
"""s that one answer is waited for on the spot."""
MOST = 1.5e-3
"""s that answers of several devices, which are waited for together, are at most."""
IN_A_ROW = 2e-3
"""s without a turn of the event loop after which it gets one."""
_MOST_AT_ONCE = 8
"""Things that are taken in, of what is there already, before the event loop gets its turn."""
_MOST_FDS = 1024
"""File descriptors that ``select`` knows; nothing else waits for less than a millisecond."""
_PAUSE = 4
"""Answers that must come soon before the next one is waited for, after one that did not."""


def is_there(fd: int, seconds: float) -> bool:
    """Wait until a file descriptor has something to read, at most so long (s); whether it has."""
    return 0 <= fd < _MOST_FDS and bool(select.select((fd,), (), (), seconds)[0])


class _Turn:
    """Since when an event loop has been held up by waits on the spot; all links share it."""

    def __init__(self) -> None:
        self._since: float | None = None

    def left(self) -> float:
        """How long (s) it may still be held up."""
        now = time.monotonic()
        if self._since is None:
            self._since = now
            asyncio.get_running_loop().call_soon(self._begin)
        return self._since + IN_A_ROW - now

    def _begin(self) -> None:
        self._since = None


_TURNS: WeakKeyDictionary[asyncio.AbstractEventLoop, _Turn] = WeakKeyDictionary()


class ReplyWait(Generic[T]):
    """The wait for a reply on one bus, one at a time.

    Parameters
    ----------
    wait
        Waits on the spot, at most so long (s), until something has come, and takes it in, which may
        call `give` or `fail`; False when nothing came. From the event loop.
    """

    def __init__(self, wait: Callable[[float], bool]) -> None:
        self._wait = wait
        self._wait_limit = WaitLimit(_expire)
        self._turn: _Turn | None = None
        self._pause = 1
        self._future: asyncio.Future[None] | None = None
        self._value: T | None = None
        self._error: Exception | None = None
        self._longest = LONGEST
        self._began = 0.0
        self._given_at = 0.0
        self.waiting = False
        """Whether an answer is still wanted."""

    def begin(self, parts: int = 1) -> None:
        """From now on an answer is wanted, which so many devices give; then `get`, or `end`."""
        self._value = self._error = None
        self.waiting = True
        self._longest = LONGEST if parts == 1 else min(parts * LONGEST, MOST)
        self._began = time.monotonic()

    def give(self, value: T) -> None:
        """The answer; nothing when none is wanted."""
        if self.waiting:
            self._value = value
            self._finish()

    def fail(self, error: Exception) -> None:
        """Why there will be no answer; nothing when none is wanted."""
        if self.waiting:
            self._error = error
            self._finish()

    def end(self) -> None:
        """None is wanted any more."""
        self.waiting = False

    async def get(self, seconds: float) -> T:
        """Wait for the answer.

        Raises
        ------
        TimeoutError
            When none came in `seconds` since `begin`.
        Exception
            What was given to `fail`.
        """
        try:
            if self._pause:
                self._look()
                if not self.waiting and self._came_soon():
                    self._pause -= 1
            else:
                turn = self._turn or self._first_turn()
                may = self._longest
                if (left := turn.left()) <= 0.0:
                    await asyncio.sleep(0)
                    left = turn.left()
                self._on_the_spot(left if left < may else may)
                if self.waiting and left < may:
                    await asyncio.sleep(0)
                    self._on_the_spot(may - left)
                if self.waiting:
                    self._pause = _PAUSE
            if self.waiting:
                await self._by_the_loop(seconds)
            if self._error is not None:
                raise self._error
            return self._value  # type: ignore[return-value]
        finally:
            self.waiting = False
            self._value = self._error = None

    def _first_turn(self) -> _Turn:
        turn = self._turn = _TURNS.setdefault(asyncio.get_running_loop(), _Turn())
        return turn

    def _look(self) -> None:
        """Take in what is there already."""
        for _ in range(_MOST_AT_ONCE):
            if not self.waiting or not self._wait(0.0):
                return

    def _on_the_spot(self, may: float) -> None:
        """Wait for a moment (s)."""
        left = may if may > 0.0 else 0.0
        until = time.monotonic() + left
        while self.waiting and self._wait(left):
            left = until - time.monotonic()
            if left <= 0.0:
                break

    async def _by_the_loop(self, seconds: float) -> None:
        future = self._future = asyncio.get_running_loop().create_future()
        self._wait_limit.begin(future, self._began + seconds - time.monotonic())
        try:
            await future
        finally:
            self._wait_limit.end()
            self._future = None
        if self.waiting:
            raise TimeoutError
        self._pause = max(0, self._pause - 1) if self._came_soon() else _PAUSE

    def _came_soon(self) -> bool:
        """Whether the last answer came as soon as one that is waited for on the spot."""
        return self._given_at - self._began < self._longest

    def _finish(self) -> None:
        self.waiting = False
        self._given_at = time.monotonic()
        if self._future is not None and not self._future.done():
            self._future.set_result(None)


def _expire(future: asyncio.Future[Any]) -> None:
    future.set_result(None)
