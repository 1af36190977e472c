"""A rotary table of the simulated I++ machine, with the errors that such tables have.

It turns what stands on it about the line on which it really lies, by what it shows and what it is
wrong by. Positive is counter-clockwise seen from above. Nothing here is of `compcore`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.truth import rotation

Array = NDArray[np.float64]


@dataclass
class SimulatedTable:
    """A table that turns about the vertical.

    Attributes
    ----------
    at
        A point on its line as it really lies, workpiece's frame of the bridge, mm.
    lean
        By how much its line leans, about X and about Y, rad.
    wrong
        Amplitude of its error of angle over one turn, rad: at the angle q it is turned by
        ``q + wrong·sin q``.
    angle
        What it shows, degrees.
    stuck
        Whether it does not turn, and says so by its angle only.
    """

    at: Sequence[float]
    lean: Sequence[float] = (0.0, 0.0)
    wrong: float = 0.0
    angle: float = 0.0
    stuck: bool = False

    def turned(self, points: Array) -> Array:
        """Where points (n, 3) of the table are that are at these places at 0°, mm."""
        middle = np.asarray(self.at)
        return np.asarray((points - middle) @ self._turn().T + middle)

    def at_zero(self, points: Array) -> Array:
        """Where points (n, 3) would be at 0°, mm."""
        middle = np.asarray(self.at)
        return np.asarray((points - middle) @ self._turn() + middle)

    def _turn(self) -> Array:
        shown = math.radians(self.angle)
        along = rotation((self.lean[0], self.lean[1], 0.0)) @ np.array([0.0, 0.0, 1.0])
        return np.asarray(rotation((shown + self.wrong * math.sin(shown)) * along))
