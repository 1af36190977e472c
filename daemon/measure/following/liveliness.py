"""An instrument that is frozen: it reads the very same, where it did not before."""

from __future__ import annotations

import math

_CHANGES = 10
"""Readings that have to have changed at standstills before anything is told."""
_DIGITS = 3
"""Different readings at one standstill: what flickers between two may be still as well."""
_LONGER = 6
"""Times the longest run of the very same so far."""
_LEAST = 20
"""Readings in a row that are never too many."""


class InstrumentLiveliness:
    """Counts how often in a row an instrument reads the very same, to the last digit.

    One that is finer than its own scatter never does for long, wherever the machine stands. One
    that is coarse does at any target, and tells by its readings there that nothing is meant by it.

    Attributes
    ----------
    run
        Readings in a row that were the very same, also while the machine moved.
    """

    def __init__(self) -> None:
        self.run = 0
        self._values: tuple[float, ...] = ()
        self._time = -math.inf
        self._longest = 0
        self._changes = 0
        self._here: set[tuple[float, ...]] = set()
        self._lively = False

    def add(self, time: float, values: tuple[float, ...], *, stands: bool) -> None:
        """Take a reading in; one that was taken in before, by its time, is none.

        `stands`: at a target, settled; what still creeps says nothing of the instrument.
        """
        if time <= self._time or not values:
            return
        self._time = time
        if not stands:
            self._here.clear()
        if values == self._values:
            self.run += 1
            return
        self._longest = max(self._longest, self.run)
        self._values, self.run = values, 1
        if stands:
            self._changes += 1
            self._here.add(values)
            self._lively = self._lively or len(self._here) >= _DIGITS

    @property
    def frozen(self) -> bool:
        """Whether it reads the very same for far longer than it ever did."""
        known = self._lively and self._changes >= _CHANGES
        return known and self.run > max(_LEAST, _LONGER * self._longest)
