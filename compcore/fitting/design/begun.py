"""How far lagged bodies were from their signals when each run began, and whether that can be."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.fitting.design.design_matrix import FURTHEST, Problem

_HELD = 1.0 - 1e-6
"""Part of the furthest that is the furthest but for rounding."""


@dataclass(frozen=True, slots=True)
class Begun:
    """One effect's bodies at the beginning of one run.

    Attributes
    ----------
    file, spec, signal, unit
        The run's file, the effect, the signal that its bodies follow, and the unit of what follows.
    off
        How far each body was from equilibrium with its signal.
    furthest
        As far as one can believably have been.
    """

    file: str
    spec: str
    signal: str
    unit: str
    off: tuple[float, ...]
    furthest: float

    @property
    def plausible(self) -> bool:
        """Whether every body was nearer than the furthest; one held there wanted to be beyond."""
        return all(abs(value) < _HELD * self.furthest for value in self.off)


def begun(problem: Problem, theta: NDArray[np.float64]) -> Iterator[Begun]:
    """The beginnings of all runs for which they were fitted, at given unknowns θ."""
    layout, campaign = problem.layout, problem.campaign
    for start in layout.starts:
        effect = problem.model.effects[start.term]
        signal = problem.model.machine.signals[effect.signals_needed()[0]]
        size = theta[layout.linear_of(start.term)][: start.count]
        off = tuple(
            float(value / own) for value, own in zip(theta[start.where], size, strict=True) if own
        )
        if off:
            row = int(np.argmax(start.rows(campaign.conditions)))
            yield Begun(
                campaign.file_of(row),
                effect.spec,
                signal.name,
                "K" if signal.temperature else signal.unit,
                off,
                FURTHEST * start.span,
            )
