"""Averages of readings at a standstill, and whether they are steady enough to count."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import fmean

LEAST = 4
"""Readings of which an average is made at least."""


@dataclass(frozen=True, slots=True)
class SteadyReading:
    """The average of readings of several directions.

    Attributes
    ----------
    values
        For each direction, mm or rad.
    spreads
        Standard deviation of a single reading, likewise.
    drifts
        Mean of the second half less that of the first.
    count
        Readings in it.
    positions
        For each axis, where the machine stood meanwhile, mm or rad.
    """

    values: tuple[float, ...]
    spreads: tuple[float, ...]
    drifts: tuple[float, ...]
    count: int
    positions: tuple[float, ...]

    def sd(self, component: int, stated: float) -> float:
        """Standard uncertainty of one direction's average (mm or rad).

        The instrument's, the scatter of the mean, and a drift as if it could have ended anywhere.
        """
        scatter = self.spreads[component] / math.sqrt(self.count)
        return math.hypot(stated, scatter, self.drifts[component] / math.sqrt(12.0))

    def sds(self, stated: float) -> list[float]:
        """The same of every direction."""
        return [self.sd(k, stated) for k in range(len(self.values))]


@dataclass(slots=True)
class Averaging:
    """Gathers readings over a time.

    Parameters
    ----------
    begins
        Monotonic time from which on readings count, s.
    lasts
        s over which they are gathered.
    """

    begins: float
    lasts: float
    _readings: list[tuple[float, ...]] = field(default_factory=list)
    _positions: list[tuple[float, ...]] = field(default_factory=list)
    _last: float = -math.inf

    def add(self, time: float, values: Sequence[float], positions: Sequence[float]) -> None:
        """Take a reading in; one that was taken in before (by its time), or too early, is none."""
        if time > self._last and time >= self.begins:
            self._last = time
            self._readings.append(tuple(values))
            self._positions.append(tuple(positions))

    def full(self, now: float) -> bool:
        """Whether there is enough."""
        return now - self.begins >= self.lasts and len(self._readings) >= LEAST

    def result(self) -> SteadyReading:
        """The average of what was gathered."""
        columns = list(zip(*self._readings, strict=True))
        n = len(self._readings)
        half = n // 2
        means = [fmean(c) for c in columns]
        spreads = [
            math.sqrt(sum((x - m) ** 2 for x in c) / (n - 1))
            for c, m in zip(columns, means, strict=True)
        ]
        drifts = [fmean(c[-half:]) - fmean(c[:half]) for c in columns]
        at = [fmean(c) for c in zip(*self._positions, strict=True)]
        return SteadyReading(tuple(means), tuple(spreads), tuple(drifts), n, tuple(at))


def unsteady(reading: SteadyReading, max_drift: float, max_spread: float) -> str:
    """Why readings do not count, in units of 1e-3 mm or 1e-6 rad as the limits are; else empty.

    The drift counts only as far as it is more than scatter: halves of noisy readings differ.
    """
    for drift, spread in zip(reading.drifts, reading.spreads, strict=True):
        if spread > max_spread:
            return "spread"
        if abs(drift) > max_drift + 4.0 * spread / math.sqrt(max(reading.count, 1)):
            return "drift"
    return ""
