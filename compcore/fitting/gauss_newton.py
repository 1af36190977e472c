"""Gauss–Newton for linear and nearly linear least squares; damped where slopes lead too far.

A step that does not lower the cost is halved, and then damped as by Levenberg and Marquardt: what
is hardly determined is held back first, where a shorter step would hold back all.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.determinacy import Decomposition
from abbe.compcore.fitting.reduction import triangle

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

_ROUNDS = 50
_HALVINGS = 3
_DAMPED = 4.0
"""By how many times a step is damped more where it still leads too far."""
_CALMER = 6
"""Halvings on the way to the solution of least norm along a curve; behind a sixty-fourth of it
nothing is gained."""
_CONVERGED = 1e-9
"""The cost ½χ² may still fall by this part of itself, or of the number of rows, at the end."""
_CONVERGED_IN_FULL = 1e-6
"""The same where errors are composed in full: along a curve the last digits come slowly."""

_ROUNDING = 1e-6
"""Part by which ½χ², or that of each row, may rise where what is not determined is moved."""


def gauss_newton(
    problem: Problem, theta: F64, free: Index | None = None, *, origin: F64 | None = None
) -> tuple[F64, Decomposition]:
    """Minimise ½χ² from θ: the solution of least norm, (m,), and its decomposition.

    Parameters
    ----------
    free
        Indices of the unknowns that may move, default all; the decomposition is theirs.
    origin
        Where the unknowns stood before anything was fitted, (m,), default θ: a combination that
        the residuals moved from there beyond doubt stays determined when the fit is repeated.
    """
    start = theta
    origin = start if origin is None else origin
    direct = problem.linear and not problem.layout.searched
    free = np.arange(problem.layout.size) if free is None else free
    scale = problem.layout.scale[free]
    m = len(free)
    cost = np.inf
    in_full = problem.model.composition == "exact"
    converged = _CONVERGED_IN_FULL if in_full else _CONVERGED
    damped, undamped = 0.0, True
    for _ in range(_ROUNDS):
        reduced = triangle(problem, theta, free)
        before = 0.5 * float(reduced[:, m] @ reduced[:, m])
        decomposition = Decomposition(reduced[:m, :m], scale, problem.n)
        left = float(np.linalg.norm(reduced[m:, m])) / np.sqrt(max(problem.n - m, 1))
        decomposition.follow(reduced[:m, m], (theta - origin)[free], left)
        hardly = converged * max(before, 1e-3 * problem.n)
        if cost - before <= hardly:
            if undamped:
                break
            damped = 0.0  # a longer step may still lead lower
        cost = before
        step = np.zeros_like(theta)
        step[free] = decomposition.solve(reduced[:m, m])
        if direct:
            theta = theta + step
            break
        ahead = reduced[:, m] - reduced[:, :m] @ step[free]
        if before - 0.5 * float(ahead @ ahead) <= hardly:
            # as low as the tangent leads: a search would only find rounding
            break

        undamped = not damped
        longer = ((step * 0.5**k, 0.0) for k in range(_HALVINGS if undamped else 0))
        # what was too long a step ago mostly still is
        least = damped / _DAMPED
        shorter = (
            (_placed(theta, free, decomposition.solve(reduced[:m, m], d)), d)
            for d in _dampings(decomposition)
            if d >= least
        )
        theta, damped = _lower(problem, theta, chain(longer, shorter), before)
    calm = theta.copy()
    calm[free] = decomposition.minimum_norm(theta[free], start[free])
    if not direct:
        # along a curve, of which what is not determined is only the tangent, χ² may rise
        calm = _no_worse(problem, theta, calm)
    return calm, decomposition


def risen(problem: Problem, theta: F64, moved: F64) -> bool:
    """Whether χ² is higher at another solution, by more than rounding."""
    return _cost(problem, moved) > _allowed(problem, theta)


def _allowed(problem: Problem, theta: F64) -> float:
    before = _cost(problem, theta)
    return before + _ROUNDING * (before + problem.n)


def _no_worse(problem: Problem, theta: F64, calm: F64) -> F64:
    """As far from θ towards another solution as ½χ² does not rise."""
    allowed = _allowed(problem, theta)
    part = 1.0
    for _ in range(_CALMER):
        tried = problem.layout.within(theta + part * (calm - theta))
        if _cost(problem, tried) <= allowed:
            return tried
        part *= 0.5
    return theta


def _cost(problem: Problem, theta: F64) -> float:
    left = problem.eliminator(theta).project(problem.residual(theta))
    known = theta / problem.prior_sd
    cost = float(left @ left + known @ known)
    if problem.expected is not None:
        apart = problem.expected @ theta
        cost += float(apart @ apart)
    return 0.5 * cost


def _lower(
    problem: Problem, theta: F64, steps: Iterable[tuple[F64, float]], before: float
) -> tuple[F64, float]:
    """θ and the first of some steps with which the cost is no higher, and by what it was damped.

    θ where it is higher with all.
    """
    for step, damped in steps:
        tried = problem.layout.within(theta + step)
        if _cost(problem, tried) <= before:
            return tried, damped
    return theta, 0.0


def _placed(theta: F64, free: Index, values: F64) -> F64:
    """Values of the unknowns that may move, the others 0, shape of θ."""
    step = np.zeros_like(theta)
    step[free] = values
    return step


def _dampings(decomposition: Decomposition) -> Iterator[float]:
    """Singular values from the least to beyond the greatest that is determined."""
    if decomposition.rank:
        damping = float(decomposition.singular[: decomposition.rank].min())
        most = float(decomposition.singular[0])
        while damping <= _DAMPED * most:
            yield damping
            damping *= _DAMPED
