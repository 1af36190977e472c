"""The section ``[guard]``: how large a correction may be, how fast, how old what it comes from."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import BeforeValidator, Field

from abbe.daemon.config.sections.section import Length, Rate, Seconds, Section, Turn, TurnRate


class PerDirection(Section):
    """A number for each direction that the machine has an axis for, mm."""

    X: Length | None = None
    Y: Length | None = None
    Z: Length | None = None

    @property
    def stated(self) -> dict[str, float]:
        """Direction → number, mm."""
        every = {"X": self.X, "Y": self.Y, "Z": self.Z}
        return {direction: v for direction, v in every.items() if v is not None}


def _alike(value: object) -> object:
    return value if isinstance(value, dict) else dict.fromkeys("XYZ", value)


class GuardSection(Section):
    """What the guard allows; `abbe.daemon.guard`."""

    max_correction: Annotated[PerDirection, BeforeValidator(_alike)]
    """Largest correction, mm: one number, or one for each of X, Y, Z that the machine has."""
    max_norm: Length | None = None
    """Largest length of the correction vector, mm; default what `max_correction` allows."""
    max_rate: Rate
    """Fastest change of a correction, mm/s."""
    max_turn: Turn | dict[str, Turn] | None = None
    """Largest correction of a rotary axis, degrees: one number, or one for each of them."""
    max_turn_rate: TurnRate | None = None
    """Fastest change of such a correction, degrees/s."""
    stale_after: Seconds = 0.2
    """s after which a position counts as stale."""
    signals_stale_after: Seconds = 5.0
    """s after which a signal counts as stale."""
    max_lag: Length | None = None
    """How far an axis may have moved while its position was under way (age × measured speed), mm
    (rotary: rad), for it to be used; default: no such limit but `stale_after`."""
    hold: Annotated[float, Field(ge=0.0, le=3600.0)] = 1.0
    """s for which the last good correction is held."""
    ramp: Seconds = 2.0
    """s in which it is then ramped to zero, and later back in."""

    @property
    def vector(self) -> tuple[float, float, float]:
        """Largest correction in X, Y, Z, mm; where it is not stated, none is ever made."""
        stated = self.max_correction.stated
        x, y, z = (stated.get(d, max(stated.values(), default=0.0)) for d in "XYZ")
        return x, y, z

    def turn(self, axis: str) -> float | None:
        """Largest correction of a rotary axis, degrees; None where it is not stated."""
        return self.max_turn.get(axis) if isinstance(self.max_turn, dict) else self.max_turn

    @property
    def norm(self) -> float:
        """Largest length of the correction vector, mm."""
        stated = self.max_correction.stated.values()
        return math.hypot(*stated) if self.max_norm is None else self.max_norm
