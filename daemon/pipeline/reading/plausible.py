"""Plausibility of signals: out of range, too fast, unlike similar sensors.

A thermometer that comes loose, a wire that breaks into another, a register that flips: the reading
is a number, and the correction that it makes is the largest there is. Pure: values and times in,
doubts out. A doubted reading is not used; its last good value is, and the guard ramps out what
rests on it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import median
from typing import Protocol

_DRIFT = 1.0 / 60.0
"""Part of its fastest change at which a signal can come to differ for good, after a jump that was
not believed: a temperature that may change by 0.5 K/s is believed 0.5 K farther off a minute."""
_QUANTUM = 2.0
"""s of its fastest change that a signal may jump from one reading to the next: sensors are read in
steps, and converters settle."""


class Reading(Protocol):
    """The reading of one signal and its plausibility."""

    @property
    def value(self) -> float:
        """Last good value."""

    @property
    def fault(self) -> str:
        """Why there is no fresh one; empty when there is."""


@dataclass(frozen=True, slots=True)
class PlausibleBounds:
    """The range and the fastest change of one signal that are believed, in its unit.

    Attributes
    ----------
    low, high
        Least and greatest value.
    max_rate
        Fastest change, 1/s.
    unit
        For people.
    why
        Where `low` and `high` are from, for people: ``measured in the campaign …``.
    """

    low: float = -math.inf
    high: float = math.inf
    max_rate: float = math.inf
    unit: str = ""
    why: str = ""


@dataclass(frozen=True, slots=True)
class SimilarSensors:
    """Sensors of one role, and how far (in `unit`) one may be from the others' median."""

    names: tuple[str, ...]
    apart: float
    role: str = ""
    unit: str = ""


@dataclass(slots=True)
class _Course:
    """Where a signal was last believed, and since when it is not."""

    value: float = math.nan
    time: float = -math.inf
    doubted_since: float = math.inf


@dataclass(slots=True)
class Plausible:
    """Judges every reading of every signal.

    Parameters
    ----------
    bounds
        By signal; one without is not judged.
    similar
        Sensors that are compared with one another.
    """

    bounds: Mapping[str, PlausibleBounds]
    similar: tuple[SimilarSensors, ...] = ()
    _courses: dict[str, _Course] = field(default_factory=dict, init=False)

    def outside(self, name: str, value: float) -> str:
        """Why a value cannot be, whatever was before; empty when it can."""
        limits = self.bounds.get(name)
        if limits is None or limits.low <= value <= limits.high:
            return ""
        unit = f" {limits.unit}" if limits.unit else ""
        return f"{value:g}{unit} is not {limits.low:g} to {limits.high:g}{unit}{limits.why}"

    def doubt(self, name: str, value: float, time: float) -> str:
        """Why a reading taken at `time` (monotonic, s) is not to be believed; empty when it is."""
        limits = self.bounds.get(name)
        if limits is None:
            return ""
        unit = f" {limits.unit}" if limits.unit else ""
        if outside := self.outside(name, value):
            return outside
        course = self._courses.setdefault(name, _Course())
        far = abs(value - course.value)
        until_doubted = min(time, course.doubted_since) - course.time
        reach = limits.max_rate * (
            max(until_doubted, 0.0)
            + _QUANTUM
            + _DRIFT * max(0.0, time - min(time, course.doubted_since))
        )
        if far <= reach or math.isnan(course.value):
            course.value, course.time, course.doubted_since = value, time, math.inf
            return ""
        course.doubted_since = min(course.doubted_since, time)
        return (
            f"jumped from {course.value:g} to {value:g}{unit}; at most "
            f"{limits.max_rate:g}{unit}/s is believed"
        )

    def compared(self, readings: Mapping[str, Reading]) -> dict[str, str]:
        """Which readings are too far from those of similar sensors, and how far."""
        doubts: dict[str, str] = {}
        for similar in self.similar:
            values = {
                name: readings[name].value
                for name in similar.names
                if name in readings and not readings[name].fault
            }
            if len(values) < 2:
                continue
            middle = median(values.values())
            # of two that differ, nobody knows which is wrong
            half = 0.5 if len(values) == 2 else 1.0
            for name, value in values.items():
                if abs(value - middle) > half * similar.apart:
                    doubts[name] = (
                        f"{value:g} {similar.unit}, and the sensors of role {similar.role} are at "
                        f"{middle:g} {similar.unit}; at most {similar.apart:g} apart is believed"
                    )
        return doubts
