"""Points at which a controller was read with its correction on and off."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SwitchedPoints:
    """n points with the difference of a controller's readings, correction on minus off.

    Attributes
    ----------
    conditions
        Where: positions with the correction off (mm), tool offsets, signals.
    difference
        Reading with the correction on minus off, shape (n, 3), mm.
    sigma
        Standard deviation of a difference from the display's rounding, mm; 0 when not rounded.
    both_read
        Whether the file has both readings, so that an opposite sign cannot come from an artefact.
    """

    conditions: Conditions
    difference: F64
    sigma: float = 0.0
    both_read: bool = False

    def thinned(self, most: int) -> SwitchedPoints:
        """At most `most` of the points, evenly taken."""
        if self.n <= most:
            return self
        rows = np.linspace(0, self.n - 1, most).astype(np.int64)
        return replace(
            self, conditions=self.conditions.rows(rows), difference=self.difference[rows]
        )

    @property
    def n(self) -> int:
        """Number of points."""
        return self.conditions.n
