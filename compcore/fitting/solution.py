"""The solution of a fit: values with uncertainties, what is undetermined, what is left over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.campaign.suspicions import of_campaign, of_chi2, of_ratio, of_signals, of_values
from abbe.compcore.campaign.thinning import thinned
from abbe.compcore.distributions import chi2_beyond
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.design.nuisance import Eliminator
from abbe.compcore.fitting.design.weights import Uncertainty
from abbe.compcore.fitting.determinacy import Decomposition
from abbe.compcore.fitting.frame import ReferenceFrame, alignment, most_used
from abbe.compcore.fitting.gauss_newton import gauss_newton, risen
from abbe.compcore.fitting.reduction import leverage
from abbe.compcore.fitting.robust import Outlier, outliers_of, studentised
from abbe.compcore.fitting.separable import step_widths
from abbe.compcore.fitting.undetermined.null_space import NullSpace, split_null_space
from abbe.compcore.fitting.undetermined.parameter_fields import ParameterFields
from abbe.compcore.fitting.undetermined.words import Undetermined, in_words
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.late_thermometers import late_thermometers
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]

_MISFIT = 1e-4
_FRAME_ROUNDS = 6
_SURE = 5.0
"""Standard uncertainties below zero from which a scale shrinks without doubt."""
_SETTLED = 1e-5
"""Part of the unknowns' scales by which the choice of frame may still move them."""


@dataclass(frozen=True, eq=False, repr=False)
class Solution:
    """The solution of a fit: values and covariance, residuals, null space.

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
    frame
        The reference frame, with the tool for which it holds.
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
    frame: ReferenceFrame = field(default_factory=ReferenceFrame)

    @property
    def chi2_per_dof(self) -> float:
        """χ² divided by the degrees of freedom; 1 when model and uncertainties are right."""
        return self.chi2 / self.dof if self.dof > 0 else float("nan")

    def chi2_beside(self, other: Solution) -> float:
        """χ² of this fit's residuals in the uncertainties of another fit to the same rows.

        Where nobody stated an uncertainty each fit takes it from what it leaves itself, and its own
        χ² is the degrees of freedom, however much that is: two fits compare in those of one.
        """
        return float(np.sum((self.residual * other.problem.weight) ** 2))

    @property
    def misfit(self) -> bool:
        """Whether χ² rejects the model: so large by chance in less than 1 of 10 000 fits.

        Never where uncertainties were taken from the residuals themselves.
        """
        return not self.uncertainty.open and bool(chi2_beyond(self.chi2, self.dof) < _MISFIT)

    def seen(self, values: F64) -> F64:
        """Values of all rows, (n,), mm or rad, less what set-ups leave unknown; distances 0."""
        problem = self.problem
        sd = np.where(problem.weight > 0.0, problem.sd, 0.0)
        small = np.where(problem.campaign.kind < Kind.DISTANCE, problem.weight, 0.0)
        return np.asarray(self.eliminator.project(values * small) * sd)

    @cached_property
    def suspicions(self) -> tuple[str, ...]:
        """Suspected wrong units, turned signs and absurd uncertainties.

        Signs and units of values are seen against the model as it was, where that was fitted.
        """
        problem, campaign = self.problem, self.problem.campaign
        measured = self.seen(campaign.value)
        known = problem.model.measured_signals
        found = [*of_campaign(campaign, problem.model.machine), *of_values(campaign, measured)]
        found += of_signals(campaign, problem.model.machine, known)
        if problem.model.fit:
            before = problem.layout.of_model(problem.model, campaign)
            predicted = self.seen(problem.predicted(before))
            found += of_ratio(campaign, measured, predicted, problem.weight)
        found += [*self._shrinking(), *late_thermometers(self.model)]
        repeats = not bool(np.isfinite(campaign.sd).any())
        stated = not self.uncertainty.open
        found += of_chi2(self.chi2_per_dof, self.dof, stated=stated, repeats=repeats)
        return tuple(found)

    def _shrinking(self) -> list[str]:
        """Scales that all shrink when they warm: what nothing is made of, so a sign is turned."""
        found = [
            (value.value, value.sd)
            for term in self.model.terms
            if term.effect.kind == "scale_expansion"
            for name, value in term.values.items()
            if name == "alpha" and value.sd
        ]
        if not found or not all(alpha < -_SURE * sd and alpha < -5e-6 for alpha, sd in found if sd):
            return []
        listed = ", ".join(f"{alpha * 1e6:.1f}" for alpha, _ in found)
        return [
            f"every scale shrinks as it warms ({listed} ppm/K): are the values nominal − actual? "
            "(error = actual − indicated)"
        ]

    @property
    def determined(self) -> int:
        """How many combinations of the unknowns the campaign determines by itself."""
        return self.decomposition.rank

    def rms(self, *kinds: Kind) -> float:
        """Root mean square of the residuals of some kinds of rows, mm or rad; NaN without rows.

        Rows that were set aside do not count.
        """
        rows = np.isin(self.problem.campaign.kind, kinds) & (self.problem.weight > 0.0)
        return float(np.sqrt(np.mean(self.residual[rows] ** 2))) if rows.any() else float("nan")

    @cached_property
    def undetermined(self) -> tuple[Undetermined, ...]:
        """What the campaign does not determine, in words; unknowns first, then conventions."""
        with threads_for(self.null.convention.size):
            return tuple(in_words(self.problem, self.theta, self.null))

    @cached_property
    def outliers(self) -> tuple[Outlier, ...]:
        """Outliers, largest first: set aside by a robust fit, or used all the same."""
        if self.set_aside:
            return self.set_aside
        with threads_for(self.problem.n * self.problem.layout.size):
            absorbed = leverage(self.problem, self.theta, self.decomposition)
        size = studentised(self.problem, self.residual, absorbed)
        return outliers_of(self.problem, self.residual, size)

    @cached_property
    def thin(self) -> Self:
        """The same fit on fewer rows that still tell causes apart (`thinning`); often on all."""
        rows = thinned(self.problem.campaign)
        return self if rows is None else self._on_rows(rows)

    @cached_property
    def eliminator(self) -> Eliminator:
        """The projection of set-ups' nuisances out of weighted columns."""
        return self.problem.eliminator(self.theta)

    @cached_property
    def gauges(self) -> Mapping[str, float]:
        """How far each gauge is from its certificate, in standard uncertainties of that."""
        return self.eliminator.gauges(self.problem.residual(self.theta))

    @cached_property
    def basis(self) -> F64:
        """Orthonormal basis of the weighted Jacobian, nuisances projected out, (n, rank).

        Where something is expected of the unknowns, the basis's part in the rows: its square is the
        hat matrix all the same.
        """
        columns = self.eliminator.project(self.problem.columns(self.theta))
        d = self.decomposition
        with threads_for(columns.size):
            mixed = columns @ (d.scale[:, None] * d.determined / d.singular[: d.rank])
            if self.problem.expected is not None:
                return np.asarray(mixed)  # the rows' part of what is orthonormal with what is known
            return np.asarray(np.linalg.qr(mixed)[0])

    def residualise(self, columns: F64) -> F64:
        """Weighted columns, (n, k), less what model and nuisances can imitate."""
        left = self.eliminator.project(columns)
        left -= self.basis @ (self.basis.T @ left)
        return left

    def effect_columns(self, effect: Effect, nonlinear: Mapping[str, float]) -> F64:
        """Weighted columns of any effect at the solution, (n, k); see `Problem.effect_columns`."""
        return self.problem.effect_columns(effect, nonlinear, self.theta)

    @classmethod
    def of(
        cls,
        problem: Problem,
        theta: F64,
        decomposition: Decomposition,
        frame: ReferenceFrame,
        uncertainty: Uncertainty,
        set_aside: tuple[Outlier, ...],
    ) -> Self:
        """The solution of a problem, in its frame, with its uncertainties.

        Parameters
        ----------
        theta, decomposition
            The solution in any frame, and what of it is determined.
        """
        theta, decomposition, null, align, frame = _in_frame(problem, theta, decomposition, frame)
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
        shown = decomposition.shown()
        # moments are found by search, not by least squares
        shown[[i for i, p in problem.layout.searched.items() if not p.smooth]] = True
        sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        fitted = problem.model.with_values(problem.layout.values(theta, sd, shown))
        return cls(
            replace(fitted, covariance=covariance[:m, :m]),
            problem,
            theta,
            decomposition,
            null,
            misfit - eliminator.share(raw),
            weighted,
            problem.nuisances(theta, raw),
            dof,
            chi2,
            uncertainty,
            set_aside,
            frame,
        )

    def _on_rows(self, rows: NDArray[np.int64]) -> Self:
        """The same model fitted to some of the rows, with the uncertainties and readings of all."""
        problem = self.problem.part(rows, self.theta)
        with threads_for(problem.n * problem.layout.size):
            origin = problem.start()
            searched = list(problem.layout.searched)
            origin[searched] = self.theta[searched]
            theta, decomposition = gauss_newton(problem, self.theta, origin=origin)
            at = {int(row): i for i, row in enumerate(rows)}
            aside = tuple(replace(o, row=at[o.row]) for o in self.set_aside if o.row in at)
            return self.of(problem, theta, decomposition, ReferenceFrame(), self.uncertainty, aside)


def _in_frame(
    problem: Problem, theta: F64, decomposition: Decomposition, frame: ReferenceFrame
) -> tuple[F64, Decomposition, NullSpace, F64, ReferenceFrame]:
    """The solution with its frame chosen, what of it is not determined, `alignment`, the frame."""
    fields = ParameterFields(problem.model, problem.campaign, problem.layout)
    for _ in range(_FRAME_ROUNDS):
        null = split_null_space(fields, theta, decomposition)
        held = frame
        if frame.primary and frame.tool is None:
            held = replace(frame, tool=most_used(problem.conditions(theta).tool))
        align = alignment(fields, theta, null, held)
        chosen = align @ theta
        if problem.linear and risen(problem, theta, chosen):
            # values far beyond belief, or time constants that nothing determines: what is not
            # felt by believable moves is felt here, and no convention is worth a worse fit
            return theta, decomposition, null, np.eye(len(theta)), held
        moved = np.abs((chosen - theta) / problem.layout.scale)
        theta = chosen
        if problem.linear or float(moved.max(initial=0.0)) < _SETTLED:
            break
        # base points turn with the frame along circles, of which the null space is the tangent
        theta, decomposition = gauss_newton(problem, theta)
    return theta, decomposition, null, align, held
