"""The time limit of waits, with one timer for all that come one after the other.

A live cycle waits some hundred times a second, nearly always for less than a millisecond. A timer
for each wait costs more than the rest of the wait; this one is set once and moved on when it rings.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any


class WaitLimit:
    """The time limit of waits for a future, one at a time.

    Parameters
    ----------
    expire
        Called with the future that was waited for in vain; not when that is done already.
    """

    def __init__(self, expire: Callable[[asyncio.Future[Any]], None]) -> None:
        self._expire = expire
        self._future: asyncio.Future[Any] | None = None
        self._deadline = 0.0
        self._timer: asyncio.TimerHandle | None = None
        self._rings_at = 0.0

    def begin(self, future: asyncio.Future[Any], seconds: float) -> None:
        """Wait for a future, at most so long; from the event loop."""
        self._future = future
        self._deadline = deadline = time.monotonic() + seconds
        if self._timer is None or self._rings_at > deadline:
            self._set(deadline)

    def end(self) -> None:
        """The wait is over."""
        self._future = None

    def _set(self, at: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._rings_at = at
        loop = asyncio.get_running_loop()
        self._timer = loop.call_later(max(0.0, at - time.monotonic()), self._ring)

    def _ring(self) -> None:
        self._timer = None
        future = self._future
        if future is None or future.done():
            return
        if time.monotonic() < self._deadline:
            self._set(self._deadline)
        else:
            self._expire(future)
