"""How fast the axes move, measured, and how far they went while their positions were under way."""

from __future__ import annotations

import math
from collections.abc import Sequence

_SHORTEST = 1e-3
"""s between two samples below which no speed is told from them."""


class Motion:
    """Speeds from one sample to the next.

    Parameters
    ----------
    count
        Number of axes.
    """

    def __init__(self, count: int) -> None:
        self._positions = [math.nan] * count
        self._times = [-math.inf] * count
        self.speeds = [0.0] * count
        """By axis, mm/s (rotary: rad/s), without sign; the last one that is known."""

    def step(self, positions: Sequence[float], times: Sequence[float], now: float) -> list[float]:
        """How far each axis may have gone since its position was taken: age × measured speed.

        Parameters
        ----------
        positions
            mm (rotary: rad); NaN where not to be believed.
        times
            Earliest moment of each, monotonic, s.
        now
            Until when, likewise.

        Returns
        -------
        list of float
            mm (rotary: rad), 0 or more.
        """
        speeds, lags = self.speeds, []
        for i, (position, time) in enumerate(zip(positions, times, strict=True)):
            since = time - self._times[i]
            if position == position and since >= _SHORTEST:
                way = abs(position - self._positions[i])
                speeds[i] = way / since if way == way else 0.0
                self._positions[i], self._times[i] = position, time
            lags.append(speeds[i] * max(0.0, now - time) if position == position else 0.0)
        return lags
