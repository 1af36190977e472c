"""Looks at the machine that came late: what it did meanwhile, nobody saw."""

from __future__ import annotations

import math

USUAL = 4.0
"""A look is late when it comes after so many times the usual time between two."""
LEAST = 0.5
"""s between two looks that are never late."""
_FORGETS = 0.1
"""Part of the usual time that the last one counts for."""


class LateLooks:
    """Knows how often the machine is looked at, and which look came late."""

    def __init__(self) -> None:
        self._looked = math.nan
        self._usual = math.nan

    def late(self, time: float) -> bool:
        """Whether a look comes late; `time` is monotonic, s."""
        gap = time - self._looked
        late = gap > max(LEAST, USUAL * self._usual) if self._usual == self._usual else False
        if not late and gap == gap:
            known = self._usual if self._usual == self._usual else gap
            self._usual = known + _FORGETS * (gap - known)
        self._looked = time
        return late
