"""Outliers: found by a robust fit, listed by row, never silently dropped.

The fit is repeated with weights that fall where residuals are large (Huber's, whose minimum is
unique, then Tukey's biweight, which ignores the grossest). What then stands out by more than chance
allows is listed; the last fit gives full weight to everything else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.distributions import normal_limit
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.determinacy import Decomposition
from abbe.compcore.fitting.reduction import leverage

F64 = NDArray[np.float64]

_HUBER = 1.345
_TUKEY = 4.685
"""Both lose 5 % of the information when there are no outliers (Huber, Robust Statistics, 1981)."""
_ROUNDS = (6, 10)
_CHANCE = 0.01
"""Probability that the largest of n normal residuals is taken for an outlier."""
_ABSORBED = 0.999
"""A row of which the fit itself absorbs more than this cannot be judged."""

_FEW = 5.0
"""A spread from few residuals may be much too small by chance: raised by this part of 1/n."""

Solve = Callable[[Problem, F64], tuple[F64, Decomposition]]


@dataclass(frozen=True, slots=True)
class Outlier:
    """An outlier: a row whose residual is beyond chance.

    Attributes
    ----------
    row, line
        Index in the campaign, and line in its file.
    setup
        Its set-up.
    residual
        Measured − predicted, mm or rad.
    size
        In standard deviations of a residual there.
    """

    row: int
    line: int
    setup: str
    residual: float
    size: float


def limit(n: int) -> float:
    """The studentised size that the largest of n residuals exceeds only by rare chance."""
    return normal_limit(_CHANCE / (2.0 * max(n, 1)))


def studentised(problem: Problem, residual: F64, absorbed: F64) -> F64:
    """Studentised residuals (n,): in units of their own standard deviation, kind by kind.

    `absorbed` is the leverage of each row; the size is 0 where the fit absorbs a row almost wholly.
    A spread smaller than the uncertainties say is not believed where they were stated.
    """
    free = np.maximum(1.0 - absorbed, 0.0)
    judged = free > 1.0 - _ABSORBED
    size = np.where(judged, residual * problem.weight / np.sqrt(np.where(judged, free, 1.0)), 0.0)
    for kind in np.unique(problem.campaign.kind):
        rows = (problem.campaign.kind == kind) & judged
        if rows.any():
            spread = 1.4826 * float(np.median(np.abs(size[rows])))
            spread *= 1.0 + _FEW / rows.sum()
            if np.isfinite(problem.campaign.sd[rows]).all():
                spread = max(spread, 1.0)
            if spread > 0.0:
                size[rows] /= spread
    return size


def outliers_of(problem: Problem, residual: F64, size: F64) -> tuple[Outlier, ...]:
    """The rows whose studentised residuals are beyond chance, largest first."""
    campaign = problem.campaign
    setup = campaign.conditions.setup
    beyond = np.flatnonzero(np.abs(size) > limit(problem.n))
    return tuple(
        Outlier(
            int(i),
            int(campaign.line[i]),
            "" if setup is None else str(setup[i]),
            float(residual[i]),
            float(abs(size[i])),
        )
        for i in beyond[np.argsort(-np.abs(size[beyond]))]
    )


def reject(problem: Problem, theta: F64, solve: Solve) -> tuple[F64, tuple[Outlier, ...]]:
    """The rows' uncertainties with outliers set to infinity, (n,), and the outliers.

    Parameters
    ----------
    problem
        With the rows' uncertainties.
    theta
        Where to start.
    solve
        Fits a problem from a start.
    """
    weighted = problem
    size = np.zeros(problem.n)
    residual = size
    for round_ in range(sum(_ROUNDS)):
        theta, decomposition = solve(weighted, theta)
        eliminator = weighted.eliminator(theta)
        raw = weighted.residual(theta)
        residual = problem.campaign.value - problem.predicted(theta) - eliminator.share(raw)
        absorbed = leverage(weighted, theta, decomposition)
        before, size = size, studentised(problem, residual, absorbed)
        if round_ < _ROUNDS[0]:
            factor = np.minimum(1.0, _HUBER / np.maximum(np.abs(size), 1e-300))
        else:
            factor = np.maximum(0.0, 1.0 - (size / _TUKEY) ** 2) ** 2
        if round_ > _ROUNDS[0] and float(np.abs(size - before).max()) < 0.01:
            break
        # a weight of nothing at all would leave a set-up without rows
        weighted = problem.with_sd(problem.sd / np.sqrt(np.maximum(factor, 1e-8)))
    found = outliers_of(problem, residual, size)
    sd = problem.sd.copy()
    sd[[o.row for o in found]] = np.inf
    return sd, found
