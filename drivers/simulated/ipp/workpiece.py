"""What lies on the simulated machine's table: a plate of balls, touched by a stylus.

The balls are where they are in the workpiece's frame; where the machine *says* that it touches them
is the exact machine's business. Nothing here is of `compcore`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.truth import rotation

Array = NDArray[np.float64]


@dataclass
class SimulatedPlate:
    """Balls on a plate that lies somewhere.

    Attributes
    ----------
    balls
        Their middles in the plate's own frame at 20 °C, (n, 3), mm.
    diameter
        Of the balls, mm.
    turn, at
        How it lies: rotation vector (rad) and place (mm), workpiece's frame.
    expansion
        1/K.
    thickness
        Of the plate that carries the balls by their middles, mm.
    gone
        Balls that are not there.
    """

    balls: Array
    diameter: float
    turn: Sequence[float] = (0.0, 0.0, 0.0)
    at: Sequence[float] = (0.0, 0.0, 0.0)
    expansion: float = 11.5e-6
    thickness: float = 10.0
    gone: set[int] = field(default_factory=set)

    def centres(self, temperature: float) -> Array:
        """Where the balls that are there are, (n, 3), mm."""
        kept = [i for i in range(len(self.balls)) if i not in self.gone]
        stretched = self.balls[kept] * (1.0 + self.expansion * (temperature - 20.0))
        return np.asarray(stretched @ rotation(self.turn).T + np.asarray(self.at))

    def height(self, points: Array) -> Array:
        """How far points (n, 3) that lie over or under the plate are from its middle plane, mm.

        Infinite beside it.
        """
        own = (points - np.asarray(self.at)) @ rotation(self.turn)
        low = self.balls.min(axis=0)[:2] - self.diameter
        high = self.balls.max(axis=0)[:2] + self.diameter
        over = ((own[:, :2] >= low) & (own[:, :2] <= high)).all(axis=1)
        return np.asarray(np.where(over, np.abs(own[:, 2] - self.balls[:, 2].mean()), np.inf))


def first_contact(start: Array, way: Array, centres: Array, reach: float) -> float:
    """How far a point goes from `start` along a unit vector until it is `reach` from a centre.

    mm; infinite where it passes all of them.
    """
    to = centres - start
    along = to @ way
    beside = (to**2).sum(axis=1) - along**2
    depth = reach**2 - beside
    hits = [a - math.sqrt(d) for a, d in zip(along, depth, strict=True) if d >= 0.0 and a > 0.0]
    return min((h for h in hits if h >= 0.0), default=math.inf)


def nearest(points: Array, start: Array, end: Array) -> float:
    """Least distance of points (n, 3) from a straight line between two places, mm."""
    move = end - start
    square = float(move @ move)
    part = np.zeros(len(points)) if square == 0.0 else ((points - start) @ move) / square
    foot = start + np.clip(part, 0.0, 1.0)[:, None] * move
    return float(np.linalg.norm(points - foot, axis=1).min(initial=math.inf))
