"""The fit: all effects of a model from any mixture of measurements, by weighted least squares."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.campaign.thinning import thinned
from abbe.compcore.distributions import chi2_beyond
from abbe.compcore.effects.base import Effect
from abbe.compcore.errors import FitError
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.design.nuisance import Eliminator
from abbe.compcore.fitting.design.row_blocks import rows_at_once
from abbe.compcore.fitting.design.weights import Uncertainty
from abbe.compcore.fitting.determinacy import Decomposition
from abbe.compcore.fitting.frame import ReferenceFrame, alignment
from abbe.compcore.fitting.gauss_newton import gauss_newton
from abbe.compcore.fitting.reduction import leverage
from abbe.compcore.fitting.robust import Outlier, outliers_of, reject, studentised
from abbe.compcore.fitting.separable import search, step_widths
from abbe.compcore.fitting.undetermined import NullSpace, split_null_space
from abbe.compcore.fitting.undetermined_words import Undetermined, in_words
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]
Progress = Callable[[str], None]

_MISFIT = 1e-4
_UNCERTAINTY_ROUNDS = 4
_FRAME_ROUNDS = 6
_SETTLED = 1e-5
"""Part of the unknowns' scales by which the choice of frame may still move them."""


@dataclass(frozen=True, eq=False)
class FitResult:
    """The result of a fit.

    Attributes
    ----------
    model
        The model with values, standard deviations and covariance, all in the chosen frame. Its
        covariance is scaled by χ²/dof where that is above 1, and holds what is undetermined with
        its plausible range.
    problem
        The design matrix at hand (`Problem`), with the uncertainties that were used; rows that were
        set aside have infinite ones.
    theta
        Solution, shape (problem.layout.size,).
    decomposition, null
        What of θ the data determine, and what the rest is.
    residual, weighted
        Measured − predicted − set-ups' nuisances, shape (n,): mm or rad, and in units of sd.
    nuisances
        Set-up → name → (value, unit), mm or rad.
    dof, chi2
        Degrees of freedom and Σ weighted².
    uncertainty
        The rows' standard uncertainties and where they come from.
    set_aside
        Outliers that a robust fit gave no weight.
    """

    model: Model
    problem: Problem
    theta: F64
    decomposition: Decomposition
    null: NullSpace
    residual: F64
    weighted: F64
    nuisances: Mapping[str, Mapping[str, tuple[float, str]]]
    dof: int
    chi2: float
    uncertainty: Uncertainty
    set_aside: tuple[Outlier, ...]

    @property
    def chi2_per_dof(self) -> float:
        """χ² divided by the degrees of freedom; 1 when model and uncertainties are right."""
        return self.chi2 / self.dof if self.dof > 0 else float("nan")

    @property
    def misfit(self) -> bool:
        """Whether χ² says that the model lacks something: less than 1 in 10 000 by chance.

        Never where uncertainties were taken from the residuals themselves.
        """
        return not self.uncertainty.open and bool(chi2_beyond(self.chi2, self.dof) < _MISFIT)

    def rms(self, *kinds: Kind) -> float:
        """Root mean square of the residuals of some kinds of rows, mm or rad; NaN without rows.

        Rows that were set aside do not count.
        """
        rows = np.isin(self.problem.campaign.kind, kinds) & (self.problem.weight > 0.0)
        return float(np.sqrt(np.mean(self.residual[rows] ** 2))) if rows.any() else float("nan")

    @cached_property
    def undetermined(self) -> tuple[Undetermined, ...]:
        """What this campaign cannot determine, in words; unknowns first, then conventions."""
        with threads_for(self.null.convention.size):
            return tuple(in_words(self.problem, self.theta, self.null))

    @cached_property
    def outliers(self) -> tuple[Outlier, ...]:
        """Rows that do not belong to the others, largest first: set aside, or used all the same."""
        if self.set_aside:
            return self.set_aside
        with threads_for(self.problem.n * self.problem.layout.size):
            absorbed = leverage(self.problem, self.theta, self.decomposition)
        size = studentised(self.problem, self.residual, absorbed)
        return outliers_of(self.problem, self.residual, size)

    @cached_property
    def thin(self) -> FitResult:
        """The same fit on as many rows as tell causes apart (`thinning`); often all."""
        rows = thinned(self.problem.campaign)
        return self if rows is None else _on_rows(self, rows)

    @cached_property
    def eliminator(self) -> Eliminator:
        """What projects the set-ups' nuisances out of weighted columns."""
        return self.problem.eliminator(self.theta)

    @cached_property
    def basis(self) -> F64:
        """Orthonormal basis of the weighted Jacobian, nuisances projected out, (n, rank)."""
        columns = self.eliminator.project(self.problem.columns(self.theta))
        d = self.decomposition
        with threads_for(columns.size):
            mixed = columns @ (d.scale[:, None] * d.determined / d.singular[: d.rank])
            return np.asarray(np.linalg.qr(mixed)[0])

    @cached_property
    def full_basis(self) -> F64:
        """Orthonormal basis of the weighted Jacobian and all nuisances, (n, rank + q)."""
        n, r = self.basis.shape
        out = np.zeros((n, r + self.eliminator.rank))
        out[:, :r] = self.basis
        for rows, own in self.eliminator.bases():
            out[rows, r : r + own.shape[1]] = own
            r += own.shape[1]
        return out

    def residualise(self, columns: F64) -> F64:
        """What of weighted columns, (n, k), neither model nor nuisances can imitate: C⊥."""
        left = self.eliminator.project(columns)
        left -= self.basis @ (self.basis.T @ left)
        return left

    def effect_columns(self, effect: Effect, nonlinear: Mapping[str, float]) -> F64:
        """Weighted columns of any effect at the solution, (n, k); see `Problem.effect_columns`."""
        return self.problem.effect_columns(effect, nonlinear, self.theta)


def fit(
    model: Model,
    campaign: Campaign,
    *,
    robust: bool = False,
    frame: ReferenceFrame | None = None,
    progress: Progress | None = None,
) -> FitResult:
    """Fit all effects of a model to a campaign.

    Parameters
    ----------
    robust
        Set rows aside that do not belong to the others; they are listed in the result.
    frame
        The reference frame where the measurements leave it open; default least errors.
    progress
        Told in a few words what is being done.

    Raises
    ------
    FitError
        When the campaign has no rows.
    InputError
        When the frame names axes that the machine lacks.
    """
    if not campaign.n:
        raise FitError("the campaign has no rows")
    if model.effects and all(effect.given for effect in model.effects):
        raise FitError(
            "there is nothing to fit: all values of this model are given; add what may be left "
            "('abbe add', 'abbe diagnose'), or lay it beside the measurements with 'abbe compare'"
        )
    frame = ReferenceFrame() if frame is None else frame
    frame.check(model.machine)
    uncertainty = Uncertainty.of(campaign, model.machine)
    problem = Problem(model, campaign, sd=uncertainty.sd)
    with threads_for(min(problem.n, rows_at_once(problem.layout.size)) * problem.layout.size):
        return _fit(problem, uncertainty, robust, frame, progress or (lambda _: None))


def _fit(
    problem: Problem, uncertainty: Uncertainty, robust: bool, frame: ReferenceFrame, tell: Progress
) -> FitResult:
    theta = problem.start()
    if problem.layout.searched:
        tell("searching time constants, periods and moments")
        theta = search(problem, theta)
    tell("least squares")
    problem, theta, decomposition, uncertainty = _with_uncertainty(problem, theta, uncertainty)
    set_aside: tuple[Outlier, ...] = ()
    if robust:
        tell("looking for outliers")
        sd, set_aside = reject(problem, theta, gauss_newton)
        problem = problem.with_sd(sd)
        if problem.layout.searched:
            theta = search(problem, theta)
        uncertainty = uncertainty.without(sd)
        problem, theta, decomposition, uncertainty = _with_uncertainty(problem, theta, uncertainty)
    tell("what is not determined")
    return _result(problem, theta, decomposition, frame, uncertainty, set_aside)


def _on_rows(result: FitResult, rows: NDArray[np.int64]) -> FitResult:
    """The same model fitted to some of the rows, with the uncertainties and readings of all."""
    problem = result.problem.part(rows, result.theta)
    with threads_for(problem.n * problem.layout.size):
        theta, decomposition = gauss_newton(problem, result.theta)
        at = {int(row): i for i, row in enumerate(rows)}
        aside = tuple(replace(o, row=at[o.row]) for o in result.set_aside if o.row in at)
        return _result(problem, theta, decomposition, ReferenceFrame(), result.uncertainty, aside)


def _in_frame(
    problem: Problem, theta: F64, decomposition: Decomposition, frame: ReferenceFrame
) -> tuple[F64, Decomposition, NullSpace, F64]:
    """The solution with its frame chosen, what of it is not determined, and `alignment`."""
    arguments = (problem.model, problem.campaign, problem.layout)
    for _ in range(_FRAME_ROUNDS):
        null = split_null_space(*arguments, theta, decomposition)
        align = alignment(*arguments, theta, null, frame)
        chosen = align @ theta
        moved = np.abs((chosen - theta) / problem.layout.scale)
        theta = chosen
        if problem.linear or float(moved.max(initial=0.0)) < _SETTLED:
            break
        # base points turn with the frame along circles, of which the null space is the tangent
        theta, decomposition = gauss_newton(problem, theta)
    return theta, decomposition, null, align


def _with_uncertainty(
    problem: Problem, theta: F64, uncertainty: Uncertainty
) -> tuple[Problem, F64, Decomposition, Uncertainty]:
    """The solution, and the uncertainties that no row states, found together."""
    theta, decomposition = gauss_newton(problem, theta)
    if uncertainty.open:
        for _ in range(_UNCERTAINTY_ROUNDS):
            raw = problem.residual(theta)
            left = problem.eliminator(theta).project(raw) * problem.sd
            absorbed = leverage(problem, theta, decomposition)
            uncertainty = uncertainty.updated(problem.campaign, left, absorbed)
            problem = problem.with_sd(uncertainty.sd)
            theta, decomposition = gauss_newton(problem, theta)
    return problem, theta, decomposition, uncertainty


def _result(
    problem: Problem,
    theta: F64,
    decomposition: Decomposition,
    frame: ReferenceFrame,
    uncertainty: Uncertainty,
    set_aside: tuple[Outlier, ...],
) -> FitResult:
    theta, decomposition, null, align = _in_frame(problem, theta, decomposition, frame)
    eliminator = problem.eliminator(theta)
    misfit = problem.campaign.value - problem.predicted(theta)
    raw = misfit * problem.weight
    weighted = eliminator.project(raw)
    dof = problem.n - len(set_aside) - eliminator.rank - decomposition.rank
    chi2 = float(weighted @ weighted)
    inflation = max(1.0, chi2 / dof) if dof > 0 else 1.0
    covariance = inflation * decomposition.covariance()
    covariance += null.prior_covariance(problem.layout.scale)
    covariance = align @ covariance @ align.T
    covariance = 0.5 * (covariance + covariance.T)  # rounding must not tell two halves apart
    for i, width in step_widths(problem, theta).items():
        covariance[i, i] = width**2
    m = problem.layout.model_size
    fitted = problem.model.with_values(problem.layout.values(theta, np.sqrt(np.diag(covariance))))
    return FitResult(
        replace(fitted, covariance=covariance[:m, :m]),
        problem,
        theta,
        decomposition,
        null,
        misfit - eliminator.share(raw),
        weighted,
        eliminator.values(raw),
        dof,
        chi2,
        uncertainty,
        set_aside,
    )
