"""How warm lagged bodies were when a run began: an unknown of that run, as a set-up's zero is.

A body behind a lag τ that began elsewhere than in equilibrium with its signal errs by
``p·δ·e^(−t/τ)`` more, t in s since its run began, p the effect's parameter and δ in the signal's
unit. Of another run that says nothing, so ``p·δ`` is fitted wherever the run itself is fitted or
compared, and never belongs to the model.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects.base import Effect, Parameter
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.typical import typical

F64 = NDArray[np.float64]

Bodies = Literal["asked", "all", "none"]
"""Whose beginnings are free: first bodies of effects that ask for it, all lagged bodies, none."""


@dataclass(frozen=True, slots=True)
class RunStart:
    """The unknown beginnings of one effect's bodies in one run.

    Attributes
    ----------
    term
        Index of the model's term.
    run
        Number of the run.
    begin
        When it began, s on its own clock.
    where
        Their slice of θ: ``p·δ`` of the effect's first linear parameters p, or of all of them.
    span
        How far a body may well be from its signal when this run begins, in the signal's unit.
    """

    term: int
    run: int
    begin: float
    where: slice
    span: float

    @property
    def count(self) -> int:
        """Number of bodies."""
        return len(range(self.where.start, self.where.stop))

    def rows(self, conditions: Conditions) -> NDArray[np.bool_]:
        """The rows of this run, (n,)."""
        return np.asarray(conditions.stretches == self.run)


def runs_with_a_clock(conditions: Conditions) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """The runs, or their stretches between nights, in which time goes on: number and rows."""
    runs = conditions.stretches
    for run in np.unique(runs).tolist():
        rows = np.flatnonzero(runs == run)
        if np.ptp(conditions.time[rows]) > 0.0:
            yield run, rows


def beginning(effect: Effect, machine: Machine, bodies: Bodies) -> tuple[Parameter, ...]:
    """The linear parameters of an effect whose bodies begin where each run finds them.

    In a fit it is the first body's: where the second began cannot be told from what both do.
    """
    if not effect.settles or bodies == "none":
        return ()
    every = effect.linear(machine)
    if bodies == "all":
        return every
    return every[:1] if effect.began_anywhere else ()


def likely_span(
    machine: Machine, effect: Effect, conditions: Conditions, rows: NDArray[np.int64]
) -> float:
    """How far a body may well be from its signal when a run begins, in the signal's unit.

    Half of a common change of such a signal; more where the signal itself is further from where
    everything is in the end, the reference temperature or 0, or changes more in this run.
    """
    found = []
    for name in effect.signals_needed():
        signal, values = machine.signals[name], conditions.signal(name)[rows]
        rest = machine.reference_temperature if signal.temperature else 0.0
        first = float(values[np.argmin(conditions.time[rows])])
        found += [0.5 * typical(signal).change, abs(first - rest), float(np.ptp(values))]
    return max(found, default=0.0)


def since_begin(starts: Sequence[RunStart], conditions: Conditions) -> F64:
    """Time since each row's run began, (n,), s; infinite in runs without a clock."""
    out = np.full(conditions.n, np.inf)
    for start in starts:
        rows = start.rows(conditions)
        out[rows] = np.maximum(conditions.time[rows] - start.begin, 0.0)
    return out
