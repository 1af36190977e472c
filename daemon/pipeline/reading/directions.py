"""Approach directions: as the controller states them, or which way each axis moved last."""

from __future__ import annotations

import math
from collections.abc import Sequence

from abbe.daemon.pipeline.reading.poll import Batch, Channel


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


class StatedDirections:
    """Directions that the controller states; those of the other axes follow from their positions.

    Parameters
    ----------
    axes
        Names, in the order of the positions.
    deadbands
        For each axis, mm (rotary: rad), as in `Directions`.
    channels
        For each axis where its direction is read; None: it follows from the positions.
    """

    def __init__(
        self,
        axes: Sequence[str],
        deadbands: Sequence[float],
        channels: Sequence[Channel | None],
    ) -> None:
        self._followed = Directions(deadbands)
        self._stated = tuple(
            (i, axis, *channel)
            for i, (axis, channel) in enumerate(zip(axes, channels, strict=True))
            if channel is not None
        )

    def __call__(
        self, positions: Sequence[float], batch: Batch, faults: dict[str, str]
    ) -> list[float]:
        """1, −1 or 0 for each axis; what a channel says that is none of these is added to `faults`.

        A direction that was not read, or not well, follows from the positions (mm; rotary: rad).
        """
        directions = list(self._followed.step(positions))
        for i, axis, link, name in self._stated:
            sample = batch[link][name]
            if not sample.good:
                continue
            directions[i] = sample.value
            if sample.value not in (-1.0, 0.0, 1.0):
                faults[axis] = f"its direction reads {sample.value:g}, which is none of 1, -1, 0"
        return directions
