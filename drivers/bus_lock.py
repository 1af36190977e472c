"""The lock of a bus: one caller at a time, a bounded queue behind it."""

from __future__ import annotations

import asyncio
from types import TracebackType

from abbe.drivers.link import LinkError
from abbe.drivers.reconnect import Reconnector


class BusLock:
    """The lock of a bus that must be up: ``async with bus_lock:``.

    Parameters
    ----------
    reconnector
        The bus's connection.
    max_waiting
        Calls that may wait; one more is turned away at once.

    Attributes
    ----------
    lock
        The lock itself, for connecting while the bus is not up.
    """

    def __init__(self, reconnector: Reconnector, max_waiting: int) -> None:
        self._reconnector = reconnector
        self._max_waiting = max_waiting
        self._waiting = 0
        self.lock = asyncio.Lock()

    async def __aenter__(self) -> None:
        """Wait for the lock.

        Raises
        ------
        LinkDownError
            When the bus is down, also when it goes down while waiting.
        LinkError
            When too many wait already.
        """
        reconnector = self._reconnector
        if not reconnector.up:
            raise reconnector.down_error()
        if self._waiting >= self._max_waiting:
            raise LinkError(f"{reconnector.label}: {self._waiting} calls already wait for the bus")
        self._waiting += 1
        try:
            await self.lock.acquire()
        finally:
            self._waiting -= 1
        if not reconnector.up:
            self.lock.release()
            raise reconnector.down_error()

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give the turn to the next."""
        self.lock.release()
