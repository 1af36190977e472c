"""Whose turn it is on a bus: one caller at a time, a bounded queue behind it."""

from __future__ import annotations

import asyncio
from types import TracebackType

from abbe.drivers.link import LinkError
from abbe.drivers.reconnect import Keeper


class Turns:
    """``async with turns:`` takes a turn on a bus that is up.

    Parameters
    ----------
    keeper
        The bus's connection.
    max_waiting
        Calls that may wait; one more is turned away at once.

    Attributes
    ----------
    lock
        The turn itself, for connecting while the bus is not up.
    """

    def __init__(self, keeper: Keeper, max_waiting: int) -> None:
        self._keeper = keeper
        self._max_waiting = max_waiting
        self._waiting = 0
        self.lock = asyncio.Lock()

    async def __aenter__(self) -> None:
        """Wait for the turn.

        Raises
        ------
        LinkDownError
            When the bus is down, also when it goes down while waiting.
        LinkError
            When too many wait already.
        """
        keeper = self._keeper
        if not keeper.up:
            raise keeper.down_error()
        if self._waiting >= self._max_waiting:
            raise LinkError(f"{keeper.label}: {self._waiting} calls already wait for the bus")
        self._waiting += 1
        try:
            await self.lock.acquire()
        finally:
            self._waiting -= 1
        if not keeper.up:
            self.lock.release()
            raise keeper.down_error()

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give the turn to the next."""
        self.lock.release()
