"""Cautious values of a fit: what a campaign hardly shows stays near 0, and is never extrapolated.

Least squares gives every combination of unknowns that a campaign shows at all the value that fits
it best, however unsure: where a ball bar went round once, splines over the whole travel are free
to do anything beside it. What is known besides is how large the errors of *this* machine are: as
large as those that the campaign shows well. So each parameter is expected near 0, as far from it as
the parameters of its kind of effect are, root of their mean square; curves run in long waves, and
scales are expected as squarenesses are (`usual_errors`); and the values are the most likely ones
given both (Bayes). What is shown well keeps its value, what is not stays near 0.

How large they are is found along (empirical Bayes, the EM algorithm of Dempster, Laird and Rubin,
1977, for variance components). Kinds of which the campaign shows little are expected as large as
the others are, a fiftieth of what is believable at most. Effects that read a signal, temperatures
above all, are not 0 in any machine, and a rotary axis lies where somebody has put it: they are
expected within what is believable, and so are an instrument's. Where a set-up shows more than
is stated of its readings, something is missing there, and only its readings count for less.

Where a table turns the workpiece, a shift of all X, Y and Z is an error of the parts, and no line
shows it: there is none but where it was measured.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.alike import alike
from abbe.compcore.effects import Positioning
from abbe.compcore.fitting.caution import Caution
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.determinacy import Decomposition
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.fitting.frame import alignment
from abbe.compcore.fitting.gauss_newton import gauss_newton
from abbe.compcore.fitting.reduction import leverage, triangle
from abbe.compcore.fitting.undetermined.null_space import VOLUME, sample_volume
from abbe.compcore.fitting.undetermined.parameter_fields import ParameterFields
from abbe.compcore.fitting.usual_errors import USUAL, UsualErrors
from abbe.compcore.linalg import threads_for

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

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
    usual = UsualErrors.of(problem.model, layout)
    if not usual.kinds:
        return result
    with threads_for(problem.n * layout.size):
        spread = _spreads(result)
        held = problem.with_sd(problem.sd * spread)
        sizes = _sizes(held, result.theta, usual)
        held.expected = _expected(usual, sizes, layout.scale)
        blank = result.theta.copy()
        blank[_linear(problem)] = 0.0  # where nothing is known
        theta, decomposition = gauss_newton(held, blank)
        align = np.eye(layout.size)
        fields = ParameterFields(problem.model, problem.campaign, layout)
        if result.frame.primary:  # else what is nearest to 0 is convention enough
            align = alignment(fields, theta, result.null, result.frame)
        elif problem.model.machine.structure.rotary:
            align = _without_shift(held, fields, theta)
        theta = align @ theta
        return _result(result, held, theta, decomposition, align, usual, sizes, spread)


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


def _expected(usual: UsualErrors, sizes: F64, scale: F64) -> F64:
    """What is expected of the unknowns as rows that should be 0, (known unknowns, m)."""
    known = np.flatnonzero(np.isfinite(sizes[: len(scale)]))
    finite = np.where(np.isfinite(sizes), sizes, 0.0)
    half = np.linalg.cholesky(usual.covariance(finite)[np.ix_(known, known)])
    out = np.zeros((len(known), len(scale)))
    out[:, known] = np.linalg.inv(half) / scale[known]
    return out


def _without_shift(problem: Problem, fields: ParameterFields, theta: F64) -> F64:
    """θ → θ without a shift of all X, Y or Z that no row shows, (m, m)."""
    model, layout = problem.model, problem.layout
    fields.place(VOLUME, lambda: sample_volume(model.machine, problem.campaign))
    translation, _ = fields.at(theta, VOLUME)
    columns = problem.eliminator(theta).project(problem.columns(theta))
    out = np.eye(layout.size)
    for i, effect in enumerate(model.effects):
        if not isinstance(effect, Positioning) or effect.axis not in ("X", "Y", "Z"):
            continue
        shape = effect.parsed_shape(model.machine)
        where = layout.linear_of(i)
        ones = np.zeros(layout.size)
        ones[where] = 1.0 if shape.family != "polynomial" else np.eye(shape.size)[0]
        if np.linalg.norm(columns @ ones) * float(layout.scale[where.start]) > 1.0:
            continue
        mean = translation[:, "XYZ".index(effect.axis)].mean(axis=0)
        out[:, : layout.model_size] -= np.outer(ones, mean[: layout.model_size])
    return out


def _sizes(problem: Problem, theta: F64, usual: UsualErrors) -> F64:
    """How large each part of the errors is expected, in scales, (k,); infinite: anyhow."""
    layout = problem.layout
    m, scale = layout.size, layout.scale
    reduced = triangle(problem, theta)
    columns = reduced[:m, :m] * scale
    # the residual at θ, as if everything that is linear had been 0
    linear = _linear(problem)
    at = np.zeros(m)
    at[linear] = theta[linear] / scale[linear]
    information = columns.T @ columns
    seen = usual.parts.T @ (columns.T @ reduced[:m, m] + information @ at)
    information = usual.parts.T @ information @ usual.parts
    size = usual.usual.copy()
    every = np.concatenate(list(usual.kinds.values()))
    for _ in range(_ROUNDS):
        found = _posterior(information, size)
        square = (found @ seen) ** 2 + np.diag(found)
        # what one kind has much of must not let the others loose
        common = min(float(square[every].mean()), USUAL**2)
        change = 0.0
        for where in usual.kinds.values():
            new = np.sqrt((square[where].sum() + _ALIKE * common) / (len(where) + _ALIKE))
            change = max(change, abs(float(np.log(new / size[where[0]]))))
            size[where] = new
        if change < _SETTLED:
            break
    return np.asarray(size)


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
    usual: UsualErrors,
    sizes: F64,
    spread: F64,
) -> FitResult:
    layout = held.layout
    stated = held.with_sd(result.problem.sd)
    stated.expected = held.expected
    eliminator = stated.eliminator(theta)
    misfit = stated.campaign.value - stated.predicted(theta)
    raw = misfit * stated.weight
    weighted = eliminator.project(raw)
    known = decomposition.singular > _NOTHING
    half = decomposition.scale[:, None] * decomposition.directions[:, known]
    half = half / decomposition.singular[known]
    covariance = half @ half.T
    # of the unknowns the part that the rows determine counts, not what was expected beforehand
    finite = np.where(np.isfinite(sizes), sizes, 0.0)
    variance = np.diag(usual.covariance(finite)) * layout.scale**2
    expected = np.isfinite(sizes[: layout.size])
    told = np.where(expected, 1.0 - np.diag(covariance) / np.where(expected, variance, 1.0), 1.0)
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
        if effect.kind in usual.kinds and layout.linear_counts[i]
    }
    found = {kind: float(sizes[where[0]]) for kind, where in usual.kinds.items()}
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
        caution=Caution(found, parts, result.decomposition.rank, spread),
    )
