"""Approach directions from positions: which way each axis moved last, noise left out."""

from __future__ import annotations

import math
from collections.abc import Sequence


class Directions:
    """Follows the axes and tells in which direction each moved last.

    A direction turns when the axis has come back from its farthest point by more than the axis's
    dead-band, so that noise and servo motion at rest do not flip it.

    Parameters
    ----------
    deadbands
        For each axis, mm (rotary: rad).
    """

    def __init__(self, deadbands: Sequence[float]) -> None:
        self._deadbands = tuple(deadbands)
        self._farthest = [math.nan] * len(self._deadbands)
        self._directions = [0.0] * len(self._deadbands)

    def step(self, positions: Sequence[float]) -> list[float]:
        """1, −1, or 0 before the first motion, for each axis; a NaN position changes nothing.

        Positions in mm (rotary: rad).
        """
        farthest, directions = self._farthest, self._directions
        for i, (position, deadband) in enumerate(zip(positions, self._deadbands, strict=True)):
            way = position - farthest[i]
            if farthest[i] != farthest[i] or way * directions[i] > 0.0:
                farthest[i] = position
            elif abs(way) > deadband:
                farthest[i] = position
                directions[i] = math.copysign(1.0, way)
        return directions
