"""A fitted model renewed by a later campaign: what that does not show stays as it was known.

A check after a crash, a few lines on a machine whose acceptance took two days: fitted alone, it
forgets what only the acceptance showed. Here the values of the model as it was, with their
covariance, count as data of the earlier campaigns beside the rows of the new one (Bayes; the
update of a Kalman filter without noise of its own). Effects that have changed since are let go:
nothing is known of them beforehand, the rest is held by all of its covariance with the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects.base import Effect
from abbe.compcore.errors import FitError
from abbe.compcore.fitting.design.unknowns import UnknownLayout
from abbe.compcore.fitting.determinacy import Decomposition
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.fitting.reduction import triangle
from abbe.compcore.fitting.renewal import Renewal
from abbe.compcore.fitting.undetermined.null_space import split_null_space
from abbe.compcore.fitting.undetermined.parameter_fields import ParameterFields
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]

_ROUNDS = 20
_SETTLED = 1e-6
"""Part of the unknowns' scales by which the last round may still move them."""
_SEEN = 1e-2
"""Information, 1 being what is believable at most, below which nothing was known."""
_ROUNDING = 1e-13
_LEAST = 1e-6
"""Part of what is believable at most: nothing was known better than so beforehand."""


def renewed(
    result: FitResult,
    given: Model,
    let_go: Sequence[Effect],
    variance: float = 1.0,
    counted: FitResult | None = None,
) -> FitResult:
    """A fit to a later campaign with what was known before it.

    Parameters
    ----------
    result
        The fit of `given`, or of a model with more effects, to the later campaign alone.
    given
        The model with values and covariance.
    let_go
        Effects of `given` that have changed.
    variance
        What the variance of a row counts for: 1, or more where the model leaves more than is
        stated of the rows, or these are not independent.
    counted
        Where `given` was renewed by this very campaign, the fit of its effects to it: what that
        told is taken out of what was known, so that it counts once.

    Returns
    -------
    The fit; its parameters' covariance is of both, its figures are of the later campaign.

    Raises
    ------
    FitError
        When the given model has no covariance.
    """
    if given.covariance is None:
        raise FitError("the model has no covariance: nothing is known of how sure its values are")
    problem, layout = result.problem, result.problem.layout
    spread = float(np.sqrt(variance))
    with threads_for(problem.n * layout.size):
        anchor = _anchored(result, given)
        held, pull = _held(result, given, given.covariance, let_go)
        if counted is not None:
            held, pull = _without(held, counted, given, layout, spread)
        theta, m = anchor.copy(), layout.size
        for _ in range(_ROUNDS):
            seen = triangle(problem, theta) / spread
            known = np.column_stack([held, held @ (anchor - theta) + pull])
            joined = _factor(np.vstack([seen, known]))
            decomposition = Decomposition(joined[:m, :m], layout.scale, problem.n + m)
            step = decomposition.solve(joined[:m, m])
            theta = layout.within(theta + step)
            if float(np.abs(step / layout.scale).max(initial=0.0)) < _SETTLED:
                break
            if problem.linear and not layout.searched:
                break
        let = Renewal(given, tuple(let_go), variance)
        return _result(result, let, theta, decomposition, spread)


def _factor(rows: F64) -> F64:
    """The triangular factor of rows."""
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _places(layout: UnknownLayout, model: Model, given: Model) -> list[tuple[Effect, slice]]:
    """The effects of the given model, and where they stand among the unknowns."""
    there = set(given.effects)
    return [(e, layout.terms[i]) for i, e in enumerate(model.effects) if e in there]


def _anchored(result: FitResult, given: Model) -> F64:
    """The unknowns, (m,), with the given values of all effects that were known."""
    layout, theta = result.problem.layout, result.theta.copy()
    before = {term.effect: term.values for term in given.terms}
    for effect, where in _places(layout, result.problem.model, given):
        theta[where] = [before[effect][u.name].value for u in layout.unknowns[where]]
    return theta


def _held(
    result: FitResult, given: Model, covariance: F64, let_go: Sequence[Effect]
) -> tuple[F64, F64]:
    """Rows (k, m) that hold the unknowns where they were known, in units of sd; pulls (k,)."""
    layout = result.problem.layout
    theirs: dict[Effect, range] = {}
    start = 0
    for term in given.terms:
        theirs[term.effect] = range(start, start + len(term.values))
        start += len(term.values)
    places = [p for p in _places(layout, result.problem.model, given) if p[0] not in let_go]
    mine = [j for _, where in places for j in range(where.start, where.stop)]
    own = [j for effect, _ in places for j in theirs[effect]]
    scale = layout.scale[mine]
    known = covariance[np.ix_(own, own)] / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(0.5 * (known + known.T))
    rows = np.zeros((len(mine), layout.size))
    rows[:, mine] = (vectors / np.maximum(np.sqrt(np.maximum(values, 0.0)), _LEAST)).T / scale
    return rows, np.zeros(len(mine))


def _without(
    held: F64, counted: FitResult, given: Model, layout: UnknownLayout, spread: float
) -> tuple[F64, F64]:
    """What was known less what a campaign told that is counted in it: rows and pulls.

    The given values are the most likely ones of both, so what was known pulls at them as much as
    the campaign does the other way.
    """
    problem = counted.problem
    m, size = problem.layout.model_size, problem.layout.size
    reduced = triangle(problem, _anchored(counted, given)) / spread
    # what belongs to a placing is free: it goes in front, and out
    order = [*range(m, size), *range(m), size]
    told = _factor(reduced[:, order])[size - m :, size - m :]
    at = [
        j
        for _, where in _places(layout, counted.problem.model, given)
        for j in range(*where.indices(layout.size))
    ]
    scale = layout.scale[at]
    rows = told[:, :m] * scale
    before = held[:, at] * scale
    values, vectors = np.linalg.eigh(before.T @ before - rows.T @ rows)
    sure = values > max(_SEEN, _ROUNDING * float(values.max(initial=0.0)))
    root = np.sqrt(values[sure])
    left = np.zeros((int(sure.sum()), layout.size))
    left[:, at] = (vectors[:, sure] * root).T / scale
    pull = -(vectors[:, sure].T @ (rows.T @ told[:, m])) / root
    return left, pull


def _result(
    result: FitResult, renewal: Renewal, theta: F64, decomposition: Decomposition, spread: float
) -> FitResult:
    problem, layout = result.problem, result.problem.layout
    eliminator = problem.eliminator(theta)
    misfit = problem.campaign.value - problem.predicted(theta)
    raw = misfit * problem.weight
    weighted = eliminator.project(raw)
    null = split_null_space(
        ParameterFields(problem.model, problem.campaign, layout), theta, decomposition
    )
    covariance = decomposition.covariance()
    # of the unknowns the part that the rows determine counts, not what was known beforehand
    reduced = triangle(problem, theta)[: layout.size, : layout.size] / spread
    used = float(np.sum((reduced @ covariance) * reduced))
    dof = problem.n - len(result.set_aside) - eliminator.rank - round(used)
    covariance = covariance + null.prior_covariance(layout.scale)
    covariance = 0.5 * (covariance + covariance.T)
    m = layout.model_size
    shown = decomposition.shown()
    shown[[i for i, p in layout.searched.items() if not p.smooth]] = True
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    fitted = problem.model.with_values(layout.values(theta, sd, shown))
    return replace(
        result,
        model=replace(fitted, covariance=covariance[:m, :m]),
        theta=theta,
        decomposition=decomposition,
        null=null,
        residual=misfit - eliminator.share(raw),
        weighted=weighted,
        nuisances=problem.nuisances(theta, raw),
        dof=dof,
        chi2=float(weighted @ weighted),
        renewal=renewal,
    )
