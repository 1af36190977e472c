"""Effects that act through others: tried at the values that the others would have beside them.

What a thermometer that reads wrong does to the machine is proportional to the expansions that read
it, and these were fitted without it: of a scale that warms from 20.5 to 22 °C a thermometer that
shows a kelvin too much makes 7 ppm/K out of 9, and of another scale 12 out of 13. With columns in
such a ratio the one cause that is there says less than three that are not. So the expansions are
fitted beside it, its columns made anew, and so on until neither moves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.candidates import Candidate
from abbe.compcore.diagnosis.screening.projection.basis import SEEN, Basis
from abbe.compcore.fitting.fit import FitResult

F64 = NDArray[np.float64]

_ROUNDS = 60
_SETTLED = 0.1
"""Fall of χ² between two rounds, in units of the noise, from which on they are done."""


def acting_through(
    result: FitResult, basis: Basis, candidates: Sequence[Candidate]
) -> list[Candidate]:
    """The same candidates, those that act through the model's effects at values fitted beside them.

    Parameters
    ----------
    result, basis
        The fitted model, and what it leaves.
    candidates
        What is to be tried. One that says less than its coefficient costs stays as it is.
    """
    values = _ValuesBeside(result, basis)
    return [
        replace(c, through=values.of(c)) if c.effect.reads_model and not c.nonlinear_count else c
        for c in candidates
    ]


class _ValuesBeside:
    """The unknowns of a fitted model, fitted again beside one more effect."""

    def __init__(self, result: FitResult, basis: Basis) -> None:
        self._result, self._basis = result, basis
        self._variance = basis.chi2 / max(1, basis.dof)

    @cached_property
    def _step(self) -> F64:
        """What a change of each row's weighted reading does to θ, (size, n).

        0 for what is no coefficient of an effect that moves the machine.
        """
        result = self._result
        problem = result.problem
        columns = result.eliminator.project(problem.columns(result.theta))
        step = result.decomposition.covariance() @ columns.T
        fixed = np.ones(len(step), dtype=np.bool_)
        for i, effect in enumerate(problem.model.effects):
            fixed[problem.layout.linear_of(i)] = effect.reads_model
        step[fixed] = 0.0
        return np.asarray(step)

    def of(self, candidate: Candidate) -> F64 | None:
        """θ beside a candidate, shape (size,); None where it does not matter, or never settles."""
        result, basis = self._result, self._basis
        theta, before = result.theta, -math.inf
        for k in range(_ROUNDS):
            columns = result.problem.effect_columns(candidate.effect, {}, theta)
            projected = basis.project(columns)
            if np.linalg.norm(projected) <= SEEN * np.linalg.norm(columns):
                return None
            amount = np.linalg.lstsq(projected, basis.residual, rcond=1e-8)[0]
            drop = float(basis.residual @ (projected @ amount))
            if k == 0 and drop < self._variance * math.log(basis.n):
                return None
            if abs(drop - before) < _SETTLED * self._variance:
                return theta
            before = drop
            theta = result.theta - self._step @ (result.eliminator.project(columns) @ amount)
        return None
