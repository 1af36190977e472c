"""One fitted effect as the fold evaluates it: its variables, and its error motions on rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.nodes.variable import FoldingVariable
from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.effects.expressions.expression import FormulaNode
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import INSTRUMENT, ErrorMotion
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Term
from abbe.compcore.model.reads import Reads, reads_of

F64 = NDArray[np.float64]

_PROBES = 16
_ENOUGH = 1.5
"""Periods in half the travel from which on one period's table is worth its look-up."""


class FoldedEffect:
    """One fitted effect of a model, evaluated for the fold.

    Attributes
    ----------
    error_motions
        The error motions that it moves, in the order of the columns of `values`.
    reads
        What it reads of the conditions.
    variables
        Those of the reads that change from point to point.
    kinks
        Axis → positions (mm or rad) where its slope may jump.
    """

    def __init__(
        self, machine: Machine, term: Term, among: Sequence[Term], state: SlowState
    ) -> None:
        self.effect = term.effect
        self._machine = machine
        self._coefficients = term.coefficients(machine)
        self._nonlinear = term.nonlinear(machine)
        self._among = among
        self.error_motions: tuple[ErrorMotion, ...] = ()
        rng = np.random.default_rng(1905)
        axes = machine.structure.axes
        where = {a: rng.uniform(*machine.axis(a).travel, _PROBES) for a in axes}
        moved = {a: rng.integers(-1, 2, _PROBES).astype(np.float64) for a in axes}
        found: dict[ErrorMotion, None] = {}

        def run(conditions: Conditions) -> None:
            found.update((error_motion, None) for error_motion, _ in self._motions(conditions))

        self.reads: Reads = reads_of(run, state.conditions(where, moved))
        self.error_motions = tuple(found)
        self._column = {error_motion: i for i, error_motion in enumerate(self.error_motions)}
        positions = [self._coordinate(a) for a in axes if a in self.reads.positions]
        directions = [FoldingVariable(a, "direction") for a in axes if a in self.reads.directions]
        self.variables = (*positions, *directions)
        self.kinks = self.effect.kinks(machine)

    def _coordinate(self, name: str) -> FoldingVariable:
        """The position of an axis, or its phase where the effect repeats along it often enough."""
        axis = self._machine.axis(name)
        period = self.effect.repeats(self._machine, self._nonlinear).get(name, 0.0)
        if len(self.reads.positions) > 1 or not 0.0 < period < axis.half_travel / _ENOUGH:
            return FoldingVariable(name)
        return FoldingVariable(name, "phase", period)

    def values(self, conditions: Conditions) -> F64:
        """The error motions on n rows, shape (n, number of error motions), mm or rad."""
        total = np.zeros((conditions.n, len(self.error_motions)))
        for error_motion, value in self._motions(conditions):
            total[:, self._column[error_motion]] += value
        return total

    def expressions(self) -> tuple[tuple[float, FormulaNode], ...] | None:
        """Its error motion as numbers times expressions; None where it is none."""
        return self.effect.expressions(self._machine, self._coefficients)

    def _motions(self, conditions: Conditions) -> list[tuple[ErrorMotion, F64]]:
        motions = self.effect.motions_among(self._machine, conditions, self._nonlinear, self._among)
        return [
            (motion.error_motion, motion.amount(self._coefficients))
            for motion in motions
            if motion.error_motion.place != INSTRUMENT
        ]
