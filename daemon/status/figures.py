"""Figures of a run: errors before and after against a reference, cycle times, drift."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Any

from abbe.daemon.pipeline.reading.convert import SignalReading
from abbe.daemon.pipeline.record import CycleRecord


@dataclass(slots=True)
class ErrorFigures:
    """Root mean square and largest of a length, taken in one by one; µm in, µm out."""

    count: int = 0
    squares: float = 0.0
    max: float = math.nan

    def add(self, value: float) -> None:
        """Take one value in."""
        self.count += 1
        self.squares += value * value
        if not value <= self.max:
            self.max = value

    @property
    def rms(self) -> float:
        """Root mean square; NaN before the first value."""
        return math.sqrt(self.squares / self.count) if self.count else math.nan


@dataclass(slots=True)
class Durations:
    """Quantiles of any number of durations in bounded memory, to within one per cent.

    Attributes
    ----------
    count
        How many there were.
    seconds
        Their sum.
    """

    count: int = 0
    seconds: float = 0.0
    _bins: Counter[int] = field(default_factory=Counter)

    def add(self, seconds: float) -> None:
        """Take one duration in, s."""
        self.count += 1
        self.seconds += seconds
        self._bins[round(math.log(max(seconds, 1e-9)) / _BIN)] += 1

    def quantile(self, share: float) -> float:
        """The duration (s) that `share` of all do not exceed; NaN before the first."""
        left = share * self.count
        for number in sorted(self._bins):
            left -= self._bins[number]
            if left <= 0.0:
                return math.exp(number * _BIN)
        return math.nan

    def within(self, limits: Sequence[float]) -> list[int]:
        """How many were no longer than each of some rising limits, s."""
        counts = [0] * len(limits)
        for number, count in self._bins.items():
            at = bisect_left(limits, math.exp(number * _BIN))
            if at < len(limits):
                counts[at] += count
        return list(accumulate(counts))


_BIN = 0.01
"""Width of a bin of `Durations` in ln s."""


def volumetric_errors(record: CycleRecord, axes: Sequence[int]) -> tuple[float, float] | None:
    """Distance of the indicated and of the corrected position from the reference, µm.

    Parameters
    ----------
    record
        One cycle.
    axes
        Indices of the corrected linear axes in `CycleRecord.indicated`.

    Returns
    -------
    Before and after; None where a position or the reference is missing.
    """
    reference = [record.reference[i] for i in axes]
    if not all(map(math.isfinite, reference)):
        return None
    before = 1e3 * math.dist(reference, [record.indicated[i] for i in axes])
    after = 1e3 * math.dist(reference, record.corrected[: len(axes)])
    return (before, after) if math.isfinite(before) and math.isfinite(after) else None


@dataclass
class Figures:
    """A listener that gathers a run's figures.

    Errors count in the cycles in which every axis is corrected in full; the ramps at both ends
    and times of fault do not.

    Attributes
    ----------
    axes
        Indices of the corrected linear axes in a record's positions.
    durations
        Of all cycles.
    before, after
        Volumetric error of the indicated and of the corrected position, µm.
    coolest, warmest
        Lowest and highest value of each signal.
    """

    axes: tuple[int, ...]
    durations: Durations = field(default_factory=Durations)
    before: ErrorFigures = field(default_factory=ErrorFigures)
    after: ErrorFigures = field(default_factory=ErrorFigures)
    coolest: dict[str, float] = field(default_factory=dict)
    warmest: dict[str, float] = field(default_factory=dict)
    _seen: Mapping[str, SignalReading] | None = None

    def __call__(self, record: CycleRecord) -> None:
        """Take a cycle in."""
        self.durations.add(record.duration)
        if not record.decision.compensating:
            return
        errors = volumetric_errors(record, self.axes)
        if errors is not None:
            self.before.add(errors[0])
            self.after.add(errors[1])
        # signals are read more seldom than positions, and replaced as a whole when they are
        if record.signals is not self._seen:
            self._seen = record.signals
            self._span(record.signals)

    def _span(self, signals: Mapping[str, SignalReading]) -> None:
        for name, reading in signals.items():
            if not reading.fault:
                self.coolest[name] = min(self.coolest.get(name, math.inf), reading.value)
                self.warmest[name] = max(self.warmest.get(name, -math.inf), reading.value)

    def cycle_ms(self, share: float) -> float:
        """A quantile of the cycle time, ms; NaN before the first cycle."""
        return 1e3 * self.durations.quantile(share)

    @property
    def improvement(self) -> float:
        """Root mean square error before over after."""
        return self.before.rms / self.after.rms if self.after.count else math.nan

    def drift(self) -> Mapping[str, float]:
        """By how much each signal changed, in its unit."""
        return {name: self.warmest[name] - self.coolest[name] for name in self.coolest}

    def summary(self) -> dict[str, Any]:
        """As in formats.md (``demo --json``), with what else is of use."""
        return {
            "rms_before_um": round(self.before.rms, 3),
            "max_before_um": round(self.before.max, 3),
            "rms_after_um": round(self.after.rms, 3),
            "max_after_um": round(self.after.max, 3),
            "improvement": round(self.improvement, 2),
            "cycles": self.durations.count,
            "cycle_ms_median": round(self.cycle_ms(0.5), 3),
            "cycle_ms_p99": round(self.cycle_ms(0.99), 3),
            "cycles_corrected_in_full": self.after.count,
            "drift": {name: round(value, 3) for name, value in self.drift().items()},
        }
