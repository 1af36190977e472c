"""A gauge block or step gauge on the simulated machine's table, touched by a stylus.

Its steps are exact boxes, side by side along its own x. Nothing here is of `compcore`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.truth import rotation

Array = NDArray[np.float64]

_TOUCHES = 1e-7
"""mm from a surface at which it counts as touched."""


@dataclass
class SimulatedGauge:
    """A gauge that lies somewhere.

    Attributes
    ----------
    steps
        Beginning and end of every step along its own x at 20 °C, mm.
    width, height
        Of the steps along its own y and z, mm; the middle of the first face is its origin.
    turn, at
        How it lies: rotation vector (rad) and place (mm), workpiece's frame.
    expansion
        1/K.
    """

    steps: Sequence[Sequence[float]]
    width: float
    height: float
    turn: Sequence[float] = (0.0, 0.0, 0.0)
    at: Sequence[float] = (0.0, 0.0, 0.0)
    expansion: float = 11.5e-6

    def distance(self, points: Array, temperature: float) -> Array:
        """How far points (n, 3) are from its surface, mm; 0 inside."""
        own = (points - np.asarray(self.at)) @ rotation(self.turn)
        steps = np.asarray(self.steps) * (1.0 + self.expansion * (temperature - 20.0))
        found = np.full(len(own), np.inf)
        for begins, ends in steps:
            low = np.array([begins, -0.5 * self.width, -0.5 * self.height])
            high = np.array([ends, 0.5 * self.width, 0.5 * self.height])
            off = np.maximum(np.maximum(low - own, own - high), 0.0)
            found = np.minimum(found, np.linalg.norm(off, axis=1))
        return found

    def contact(self, start: Array, way: Array, tip: float, temperature: float) -> float:
        """How far a ball of radius `tip` goes along a unit vector until it touches, mm."""
        gone = 0.0
        for _ in range(500):
            room = float(self.distance((start + gone * way)[None, :], temperature)[0]) - tip
            if room < _TOUCHES:
                return gone
            gone += room
            if gone > 1000.0:
                break
        return math.inf
