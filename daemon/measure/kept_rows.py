"""Rows on their way to the disk: in order, none lost while there is no room."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from abbe.compcore.files.growing_campaign import GrowingCampaign, Row

_LAST_TRIES = 5.0
"""s for which, at the end, rows that are not on the disk are tried to be written."""
_AGAIN = 1.0
"""s until a disk that took nothing is tried again."""


@dataclass(frozen=True, slots=True)
class _UnwrittenRows:
    rows: Sequence[Row]
    setup: str
    free: tuple[str, ...]
    perhaps_lost: Mapping[str, Sequence[float]]
    written: Callable[[], None]


class KeptRows:
    """The rows that were measured; each is on the disk, or waits in memory until it can be.

    Parameters
    ----------
    file
        Where they go.

    Attributes
    ----------
    problem
        Why the last ones are not on the disk; empty when all are.
    """

    def __init__(self, file: GrowingCampaign) -> None:
        self._file = file
        self._waiting: deque[_UnwrittenRows] = deque()
        self._due = 0.0
        self.problem = ""

    @property
    def waiting(self) -> int:
        """Targets whose rows are not on the disk."""
        return len(self._waiting)

    def add(
        self,
        rows: Sequence[Row],
        setup: str,
        free: tuple[str, ...],
        written: Callable[[], None],
        now: float,
        perhaps_lost: Mapping[str, Sequence[float]] = MappingProxyType({}),
    ) -> None:
        """Take the rows of a target; `written` is called when they are on the disk.

        Parameters
        ----------
        setup, free
            The set-up that they are of, and what its placing leaves unknown.
        now
            Monotonic, s.
        perhaps_lost
            Set-up that was written before → times from which its rows may count from elsewhere.
        """
        self._waiting.append(_UnwrittenRows(rows, setup, free, perhaps_lost, written))
        self.flush(now)

    def withdraw(self) -> bool:
        """Take the rows of the target that was added last away; whether they are gone."""
        if self._waiting:
            self._waiting.pop()
            return True
        try:
            self._file.withdraw()
        except OSError as error:
            self.problem = error.strerror or str(error)
            return False
        return True

    def flush(self, now: float, *, at_once: bool = False) -> None:
        """Bring to the disk what waits, not sooner than a moment after it was tried in vain."""
        if not self._waiting or (self.problem and now < self._due and not at_once):
            return
        while self._waiting:
            first = self._waiting[0]
            try:
                self._file.declare(first.setup, first.free, first.perhaps_lost)
                self._file.append(first.rows)
            except OSError as error:
                self.problem = error.strerror or str(error)
                self._due = now + _AGAIN
                return
            self._waiting.popleft()
            first.written()
        self.problem = ""

    async def last(self) -> None:
        """At the end: bring to the disk what waits, as long as that may take."""
        until = time.monotonic() + _LAST_TRIES
        while self.waiting and time.monotonic() < until:
            self.flush(time.monotonic(), at_once=True)
            await asyncio.sleep(0.2)
