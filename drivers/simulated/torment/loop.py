"""One thread that waits for bytes and moments, and knows between which times bytes can have come.

A byte that is found at `late` cannot have come before `early`, when nothing was there yet. On a
busy computer the two lie apart; who judges by them is never unjust.
"""

from __future__ import annotations

import heapq
import itertools
import select
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

SHORT = 0.002
"""s between two looks."""
STALL = 0.1
"""A look that took so much longer than meant is a stall, s."""


class Moment(NamedTuple):
    """Between which monotonic times (s) something happened."""

    early: float
    late: float


Reader = Callable[[Moment], None]


class Loop:
    """Waits for file descriptors and times.

    Attributes
    ----------
    stalls
        (begin, end) of times in which this process did not run, monotonic, s.
    delays
        (when, how much) something came later than it was to come, monotonic, s.
    expected
        Since when something is under way that ought to come at once; infinite: nothing is.
    """

    def __init__(self) -> None:
        self._poll = select.epoll()
        self._readers: dict[int, Reader] = {}
        self._empty: dict[int, float] = {}
        self._timers: list[tuple[float, int, Callable[[], object]]] = []
        self._count = itertools.count()
        self._last = time.monotonic()
        self.stalls: list[tuple[float, float]] = []
        self.expected = float("inf")
        self.delays: deque[tuple[float, float]] = deque(maxlen=2000)

    def watch(self, fd: int, reader: Reader) -> None:
        """Call `reader` whenever `fd` can be read."""
        self._readers[fd] = reader
        self._empty[fd] = time.monotonic()
        self._poll.register(fd, select.EPOLLIN | select.EPOLLHUP | select.EPOLLERR)

    def forget(self, fd: int) -> None:
        """Watch it no longer; safe to call twice."""
        if self._readers.pop(fd, None) is not None:
            self._poll.unregister(fd)
            del self._empty[fd]

    def at(self, when: float, call: Callable[[], object]) -> None:
        """Call at a monotonic time, s."""
        heapq.heappush(self._timers, (when, next(self._count), call))

    def after(self, seconds: float, call: Callable[[], object]) -> None:
        """Call in so many s."""
        self.at(time.monotonic() + seconds, call)

    def turn(self) -> float:
        """Look once, wait for at most 2 ms; hands back the time."""
        entered = time.monotonic()
        if entered - self._last > STALL:
            self.stalls.append((self._last, entered))
        wait = SHORT
        if self._timers:
            wait = max(0.0, min(wait, self._timers[0][0] - entered))
        ready = self._poll.poll(wait)
        now = time.monotonic()
        if now - entered > wait + 0.002:
            self.delays.append((now, now - entered - wait))
        if now - entered > wait + STALL:
            self.stalls.append((entered, now))
        found = {fd for fd, _ in ready}
        for fd in self._empty:
            if fd not in found:
                self._empty[fd] = entered
        for fd in found:
            reader = self._readers.get(fd)
            if reader is not None:
                reader(Moment(self._empty.get(fd, entered), now))
        while self._timers and self._timers[0][0] <= now:
            heapq.heappop(self._timers)[2]()
        self._last = time.monotonic()
        return self._last

    def delayed(self, early: float, late: float) -> float:
        """The largest delay between two monotonic times, s."""
        largest = max(0.0, late - max(self.expected, early))
        for when, delay in reversed(self.delays):
            if when < early:
                break
            if when - delay < late:
                largest = max(largest, delay)
        return largest

    def close(self) -> None:
        """End it."""
        self._poll.close()
