"""Folding variables: an axis's position, its phase in a period, its approach direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

DIRECTIONS = np.array([0.0, 1.0, -1.0])
"""Approach directions in the order of a direction table's rows: index −1 is the last."""


@dataclass(frozen=True, slots=True)
class FoldingVariable:
    """A coordinate on which error motions depend.

    Attributes
    ----------
    axis
        The axis's name.
    kind
        ``position`` (mm or rad), ``phase`` (mm or rad from the lower end of the travel, modulo
        `period`) or ``direction`` (1, −1, 0).
    period
        Of a phase: what repeats along the axis, mm or rad.
    """

    axis: str
    kind: Literal["position", "phase", "direction"] = "position"
    period: float = 0.0

    def travel(self, machine: Machine) -> tuple[float, float]:
        """Least and greatest value."""
        if self.kind == "position":
            return machine.axis(self.axis).travel
        return (0.0, self.period) if self.kind == "phase" else (-1.0, 1.0)

    def anchor(self, machine: Machine) -> float:
        """Where other variables' tables take this one to stand."""
        return machine.axis(self.axis).middle if self.kind == "position" else 0.0

    def some(self, machine: Machine, count: int, rng: np.random.Generator) -> F64:
        """Random values, shape (count,)."""
        if self.kind == "direction":
            return rng.integers(-1, 2, count).astype(np.float64)
        return rng.uniform(*self.travel(machine), count)
