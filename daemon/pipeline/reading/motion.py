"""Speeds of the axes, measured while their positions were under way."""

from __future__ import annotations

import math
from collections.abc import Sequence

_APART = 0.05
"""s between the two samples of a speed: less makes steps of the encoder into speeds."""


class SampleSpeeds:
    """Speeds of the axes from one sample to a later one.

    Parameters
    ----------
    count
        Number of axes.
    """

    def __init__(self, count: int) -> None:
        self._positions: Sequence[float] = [math.nan] * count
        self._time = -math.inf
        self.speeds = (0.0,) * count
        """By axis, mm/s (rotary: rad/s), without sign; the last one that is known."""

    def step(self, positions: Sequence[float], time: float) -> None:
        """Take in positions, mm (rotary: rad; NaN where unknown), and their time, monotonic, s."""
        since = time - self._time
        if since < _APART or since != since:
            return
        speeds = list(self.speeds)
        for i, (position, before) in enumerate(zip(positions, self._positions, strict=True)):
            way = abs(position - before)
            if way == way:
                speeds[i] = way / since
        self._positions, self._time, self.speeds = tuple(positions), time, tuple(speeds)
