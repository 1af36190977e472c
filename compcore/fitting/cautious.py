"""Cautious values of a fit: what a campaign hardly shows stays near 0, and is never extrapolated.

Least squares gives every combination of unknowns that a campaign shows at all the value that fits
it best, however unsure: where a ball bar went round once, splines over the whole travel are free
to do anything beside it. What is known besides is how large the errors of *this* machine are: as
large as those that the campaign shows well. So each parameter is expected near 0, as far from it as
the parameters of its kind of effect are, root of their mean square; and the values are the most
likely ones given both (Bayes). What is shown well keeps its value, what is not stays near 0.

How large they are is found along (empirical Bayes, the EM algorithm of Dempster, Laird and Rubin,
1977, for variance components). Kinds of which the campaign shows little are expected as large as
the others are, a fiftieth of what is believable at most. Effects that read a signal, temperatures
above all, are not 0 in any machine, and a rotary axis lies where somebody has put it: they are
expected within what is believable, and so are an instrument's. Where a set-up shows more than
is stated of its readings, something is missing there, and only its readings count for less.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.alike import alike
from abbe.compcore.effects import RotaryLocation
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.caution import Caution
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.determinacy import Decomposition
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.fitting.frame import alignment
from abbe.compcore.fitting.gauss_newton import gauss_newton
from abbe.compcore.fitting.reduction import leverage, triangle
from abbe.compcore.fitting.undetermined.parameter_fields import ParameterFields
from abbe.compcore.linalg import threads_for

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

USUAL = 0.02
"""Part of what is believable at most that a machine's errors usually are: where to begin."""
_ALIKE = 3.0
"""Parameters as large as the others are that each kind is counted with: of a kind with few, or that
is hardly shown, how large it is cannot be found from itself alone."""
_LEAN = 3.0
"""Readings as wrong as all are on average that each set-up is counted with."""
_ROUNDS = 200
_SETTLED = 0.01
_NOTHING = 0.5
"""Singular value below which neither rows nor expectation tell a combination: each alone makes 1,
in units of what is believable."""


def cautiously(result: FitResult) -> FitResult:
    """The same fit with cautious values, their covariance, and what they leave over.

    What is not determined is said as before; a fit that found its knots is given back as it is,
    as are models of whose effects none is of positions alone.
    """
    if result.knots:
        return result
    problem, layout = result.problem, result.problem.layout
    kinds = _kinds(problem)
    if not kinds:
        return result
    with threads_for(problem.n * layout.size):
        spread = _spreads(result)
        held = problem.with_sd(problem.sd * spread)
        sizes = _sizes(held, result.theta, kinds)
        held.prior_sd = np.minimum(problem.prior_sd, sizes)
        blank = result.theta.copy()
        blank[_linear(problem)] = 0.0  # where nothing is known
        theta, decomposition = gauss_newton(held, blank)
        align = np.eye(layout.size)
        if result.frame.primary:  # else what is nearest to 0 is convention enough
            fields = ParameterFields(problem.model, problem.campaign, layout)
            align = alignment(fields, theta, result.null, result.frame)
        theta = align @ theta
        return _result(result, held, theta, decomposition, align, kinds, spread)


def _kinds(problem: Problem) -> dict[str, Index]:
    """Kind of effect → where its linear parameters stand in θ; of effects of positions alone."""
    found: dict[str, list[int]] = {}
    for i, effect in enumerate(problem.model.effects):
        if _near_zero(effect):
            where = problem.layout.linear_of(i)
            found.setdefault(effect.kind, []).extend(range(where.start, where.stop))
    return {kind: np.array(at, dtype=np.int64) for kind, at in found.items() if at}


def _near_zero(effect: Effect) -> bool:
    if isinstance(effect, RotaryLocation):
        return False  # where a table stands is entered, not made: it is the first to be asked
    by_place = not (effect.signals_needed() or effect.reads_time() or effect.reads_model)
    return effect.scope == "machine" and by_place


def _spreads(result: FitResult) -> F64:
    """By how much each row's set-up scatters more than is stated of it, (n,), 1 or more.

    What a model lacks shows in some set-ups and not in others: by one figure for all of them, a
    scale that bends would hold the other axes near 0, of which their own set-ups leave no doubt.
    Set-ups with few readings lean on what all of them show.
    """
    campaign = result.problem.campaign
    every = max(1.0, result.chi2_per_dof) if result.dof > 0 else 1.0
    setup = campaign.conditions.setup
    if setup is None:
        return np.full(campaign.n, np.sqrt(every))
    free = 1.0 - leverage(result.problem, result.theta, result.decomposition)
    square = result.weighted**2
    aside = [outlier.row for outlier in result.set_aside]
    free[aside], square[aside] = 0.0, 0.0
    found = np.ones(campaign.n)
    for rows in alike(setup):
        own = square[rows].sum() + _LEAN * every
        found[rows] = np.sqrt(max(1.0, own / (max(free[rows].sum(), 0.0) + _LEAN)))
    return found


def _sizes(problem: Problem, theta: F64, kinds: dict[str, Index]) -> F64:
    """How far from 0 each unknown is expected, in its own unit, (m,); infinite: anywhere."""
    layout = problem.layout
    m, scale = layout.size, layout.scale
    reduced = triangle(problem, theta)
    columns = reduced[:m, :m] * scale
    # the residual at θ, as if everything that is linear had been 0
    linear = _linear(problem)
    at = np.zeros(m)
    at[linear] = theta[linear] / scale[linear]
    information = columns.T @ columns
    seen = columns.T @ reduced[:m, m] + information @ at
    size = np.full(m, np.inf)
    size[linear] = 1.0
    for where in kinds.values():
        size[where] = USUAL
    every = np.concatenate(list(kinds.values()))
    for _ in range(_ROUNDS):
        found = _posterior(information, size)
        square = (found @ seen) ** 2 + np.diag(found)
        # what one kind has much of must not let the others loose
        common = min(float(square[every].mean()), USUAL**2)
        change = 0.0
        for where in kinds.values():
            new = np.sqrt((square[where].sum() + _ALIKE * common) / (len(where) + _ALIKE))
            change = max(change, abs(float(np.log(new / size[where[0]]))))
            size[where] = new
        if change < _SETTLED:
            break
    return np.asarray(size * scale)


def _linear(problem: Problem) -> Index:
    """Where the effects' linear parameters stand in θ."""
    layout = problem.layout
    every = map(layout.linear_of, range(len(layout.terms)))
    return np.concatenate([np.arange(where.start, where.stop) for where in every])


def _posterior(information: F64, size: F64) -> F64:
    """Covariance with what is expected beforehand; infinite sizes are expected nowhere."""
    known = np.isfinite(size)
    # what nothing determines at all must not end the others' inversion
    least = np.where(known, size, 1e3)
    half = least[:, None] * information * least + np.eye(len(size))
    return np.asarray(least[:, None] * np.linalg.inv(half) * least)


def _result(
    result: FitResult,
    held: Problem,
    theta: F64,
    decomposition: Decomposition,
    align: F64,
    kinds: dict[str, Index],
    spread: F64,
) -> FitResult:
    layout = held.layout
    stated = held.with_sd(result.problem.sd)
    stated.prior_sd = held.prior_sd
    eliminator = stated.eliminator(theta)
    misfit = stated.campaign.value - stated.predicted(theta)
    raw = misfit * stated.weight
    weighted = eliminator.project(raw)
    known = decomposition.singular > _NOTHING
    half = decomposition.scale[:, None] * decomposition.directions[:, known]
    half = half / decomposition.singular[known]
    covariance = half @ half.T
    # of the unknowns the part that the rows determine counts, not what was expected beforehand
    told = 1.0 - np.diag(covariance) / held.prior_sd**2
    expected = np.isfinite(held.prior_sd)
    used = float(known.sum()) - float(np.sum(1.0 - told[expected]))
    dof = held.n - len(result.set_aside) - eliminator.rank - round(used)
    chi2 = float(weighted @ weighted)
    left = float(np.sum((weighted / spread) ** 2))
    covariance = covariance * (max(1.0, left / dof) if dof > 0 else 1.0)
    covariance = align @ covariance @ align.T
    covariance = 0.5 * (covariance + covariance.T)
    m = layout.model_size
    plain = np.zeros((layout.size, layout.size))
    if result.model.covariance is not None:
        plain[:m, :m] = result.model.covariance
    for i in layout.searched:
        covariance[i, i] = max(covariance[i, i], plain[i, i])
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    shown = result.decomposition.shown()
    shown[[i for i, p in layout.searched.items() if not p.smooth]] = True
    fitted = held.model.with_values(layout.values(theta, sd, shown))
    parts = {
        effect.spec: float(np.clip(told[layout.linear_of(i)], 0.0, 1.0).mean())
        for i, effect in enumerate(held.model.effects)
        if _near_zero(effect) and layout.linear_counts[i]
    }
    sizes = {
        kind: float(held.prior_sd[where[0]] / layout.scale[where[0]])
        for kind, where in kinds.items()
    }
    return replace(
        result,
        model=replace(fitted, covariance=covariance[:m, :m]),
        problem=stated,
        theta=theta,
        decomposition=decomposition,
        residual=misfit - eliminator.share(raw),
        weighted=weighted,
        nuisances=held.nuisances(theta, raw),
        dof=dof,
        chi2=chi2,
        caution=Caution(sizes, parts, result.decomposition.rank),
    )
