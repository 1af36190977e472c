"""Limits of the guard: the largest corrections, the fastest changes, the times."""

from __future__ import annotations

import math
from dataclasses import dataclass

Vec3 = tuple[float, float, float]

Correction = tuple[float, ...]
"""In X, Y, Z (mm), then of the rotary axes that are corrected (rad)."""

DIRECTIONS = ("X", "Y", "Z")
"""The three directions of a correction, machine axes; rotary axes come after them."""

ALL = 0b111
"""Mask of these three: bit 0 is X, bit 1 Y, bit 2 Z."""


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
    turning
        Rotary axes that are corrected, in their order after X, Y, Z.
    max_turn
        Largest correction of each, rad.
    max_turn_rate
        Fastest change of such a correction, rad/s.

    Raises
    ------
    ValueError
        When a limit is not positive and finite, or a rate does not allow the largest correction to
        be ramped to zero within `ramp`.
    """

    max_correction: Vec3
    max_norm: float
    max_rate: float
    hold: float
    ramp: float
    longest_step: float = 0.2
    turning: tuple[str, ...] = ()
    max_turn: tuple[float, ...] = ()
    max_turn_rate: float = 0.0

    @property
    def directions(self) -> tuple[str, ...]:
        """X, Y, Z and the rotary axes that are corrected: the order of a `Correction`."""
        return (*DIRECTIONS, *self.turning)

    @property
    def most(self) -> Correction:
        """Largest correction in each direction, mm, then rad."""
        return (*self.max_correction, *self.max_turn)

    @property
    def rates(self) -> Correction:
        """Fastest change in each direction, mm/s, then rad/s."""
        return (self.max_rate,) * 3 + (self.max_turn_rate,) * len(self.turning)

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
            **{f"max_turn {a}": v for a, v in zip(self.turning, self.max_turn, strict=True)},
        }
        if self.turning:
            named["max_turn_rate"] = self.max_turn_rate
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
        needed = max(self.max_turn, default=0.0) / self.ramp
        if self.max_turn_rate < needed * (1.0 - 1e-9):
            raise ValueError(
                f"max_turn_rate = {math.degrees(self.max_turn_rate):g} deg/s cannot ramp the "
                f"largest correction ({math.degrees(max(self.max_turn)):g} deg) to zero in ramp = "
                f"{self.ramp:g} s; expected at least {math.degrees(needed):g} deg/s"
            )
