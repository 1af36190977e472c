"""The pace of the cycles: a period that is kept, or as fast as the links answer."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence

from abbe.drivers.link import LinkState, LinkStatus

IDLE = 0.01
"""s to wait after a cycle in which no link had anything to wait for."""
_NAP = 0.2
"""Longest sleep between two looks at whether to end, s."""
_GOING = (LinkState.UP, LinkState.DEGRADED)


class CyclePace:
    """When the next cycle is due.

    Parameters
    ----------
    period
        s from the beginning of a cycle to that of the next; 0: the links set the pace.
    statuses
        Of the links that are read in every cycle.

    Attributes
    ----------
    missed
        Periods that were left out, because a cycle took longer.
    """

    def __init__(self, period: float, statuses: Sequence[LinkStatus]) -> None:
        self._period = period
        self._statuses = tuple(statuses)
        self._due = time.monotonic()
        self.missed = 0

    def start(self) -> None:
        """The first cycle begins now."""
        self._due = time.monotonic()

    async def wait(self, stop: asyncio.Event | None) -> None:
        """Wait for the next cycle's time; what was missed is left out.

        Parameters
        ----------
        stop
            Ends the wait within 0.2 s when it is set; None: nothing does.
        """
        if self._period == 0.0:
            going = any(status.state in _GOING for status in self._statuses)
            await asyncio.sleep(0.0 if going else IDLE)
            return
        due = self._due + self._period
        now = time.monotonic()
        wait = max(0.0, due - now)
        while wait > _NAP and not (stop is not None and stop.is_set()):
            await asyncio.sleep(_NAP)
            wait -= _NAP
        await asyncio.sleep(min(wait, _NAP))
        if due > now - self._period:
            self._due = due
        else:
            self.missed += int((now - due) / self._period)
            self._due = now
