"""Promises of a configuration in numbers, violations of them, and how much was judged."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Promises:
    """The configuration's numbers that the checker goes by: mm, s.

    Attributes
    ----------
    max_correction, max_rate, stale_after, signals_stale_after, hold, ramp, heartbeat_within
        Keys of the configuration.
    scale_x, scale_y, expansion_x
        The model: E_X = (scale_x + expansion_x·(T_x − 20 °C))·X, E_Y = scale_y·Y, E_Z = 0.
    resolution
        Steps in which positions are handed back; a correction is seen from two of them.
    blind
        How much older than its question an answer may be without anybody being able to tell, on
        wires whose answers say neither for which question they are nor when they were taken.
    slack
        For transport and for what the operating system does, beyond measured stalls.
    """

    max_correction: float = 0.1
    max_rate: float = 0.06
    stale_after: float = 0.2
    signals_stale_after: float = 1.5
    hold: float = 0.4
    ramp: float = 2.0
    heartbeat_within: float = 0.4
    scale_x: float = 1e-4
    scale_y: float = -8e-5
    expansion_x: float = 2e-5
    resolution: float = 1e-5
    blind: float = 0.0
    slack: float = 0.04

    def error(self, axis: str, position: float, temperature: float) -> float:
        """The model's error of an axis, mm."""
        if axis == "X":
            return (self.scale_x + self.expansion_x * (temperature - 20.0)) * position
        return self.scale_y * position if axis == "Y" else 0.0


@dataclass(frozen=True, slots=True)
class Violation:
    """One promise that was not kept.

    Attributes
    ----------
    time
        Monotonic, s.
    promise
        Which: `age`, `position`, `step`, `status`, `end`.
    text
        What was seen.
    """

    time: float
    promise: str
    text: str


@dataclass(slots=True)
class Tally:
    """How much was judged, so that a test cannot pass by judging nothing."""

    pictures: int = 0
    messages: int = 0
    positions: int = 0
    steps: int = 0
    compensating: int = 0
    not_judged: int = 0
    slowest_recovery: float = 0.0
    """Longest time in calm until all was corrected in full, s: liveness, not safety."""
