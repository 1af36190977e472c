"""Limits of the guard: the largest corrections, the fastest changes, the times."""

from __future__ import annotations

import math
from dataclasses import dataclass

Vec3 = tuple[float, float, float]

DIRECTIONS = ("X", "Y", "Z")
"""The three directions of a correction, machine axes."""

ALL = 0b111
"""Mask of all directions: bit 0 is X, bit 1 Y, bit 2 Z."""

ZERO: Vec3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class GuardLimits:
    """The limits of the guard.

    Attributes
    ----------
    max_correction
        Largest correction in X, Y, Z, mm.
    max_norm
        Largest length of the correction vector, mm.
    max_rate
        Fastest change of the correction in each direction, mm/s.
    hold
        How long the last good correction is held, s.
    ramp
        Time in which a full correction is then ramped to zero, and later back in, s.
    longest_step
        Time between two steps that still counts as time for a change, s: after a longer pause
        the correction moves no further than in this time.

    Raises
    ------
    ValueError
        When a limit is not positive and finite, or `max_rate` does not allow `max_correction` to
        be ramped to zero within `ramp`.
    """

    max_correction: Vec3
    max_norm: float
    max_rate: float
    hold: float
    ramp: float
    longest_step: float = 0.2

    def __post_init__(self) -> None:
        named = {
            **{
                f"max_correction {d}": v
                for d, v in zip(DIRECTIONS, self.max_correction, strict=True)
            },
            "max_norm": self.max_norm,
            "max_rate": self.max_rate,
            "ramp": self.ramp,
            "longest_step": self.longest_step,
        }
        for name, value in named.items():
            if not (value > 0.0 and math.isfinite(value)):
                raise ValueError(f"{name} must be a positive number, found {value}")
        if not (self.hold >= 0.0 and math.isfinite(self.hold)):
            raise ValueError(f"hold must be 0 s or more, found {self.hold}")
        needed = max(self.max_correction) / self.ramp
        if self.max_rate < needed * (1.0 - 1e-9):
            raise ValueError(
                f"max_rate = {self.max_rate:g} mm/s cannot ramp the largest correction "
                f"({max(self.max_correction):g} mm) to zero in ramp = {self.ramp:g} s; "
                f"expected at least {needed:g} mm/s"
            )
