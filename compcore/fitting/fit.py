"""Fit of a model's effects to any mixture of measurements, by weighted least squares."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import LENGTHS, Campaign
from abbe.compcore.campaign.noise import NoiseFloor, noise_floor
from abbe.compcore.campaign.set_ups_of_one_row import require_rows_together
from abbe.compcore.campaign.steady_thermometers import steadied
from abbe.compcore.errors import FitError, require_type
from abbe.compcore.figures.figure import Figure
from abbe.compcore.figures.shown import Shown
from abbe.compcore.fitting.caution import Caution
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.design.row_blocks import rows_at_once
from abbe.compcore.fitting.design.run_starts import Bodies
from abbe.compcore.fitting.design.weights import Uncertainty
from abbe.compcore.fitting.detail import reaching
from abbe.compcore.fitting.determinacy import Decomposition
from abbe.compcore.fitting.frame import ReferenceFrame
from abbe.compcore.fitting.gauss_newton import gauss_newton
from abbe.compcore.fitting.knots.choice import KnotChoice
from abbe.compcore.fitting.knots.found import with_knots
from abbe.compcore.fitting.knots.raster import finds_knots, on_raster
from abbe.compcore.fitting.knots.wider import widened
from abbe.compcore.fitting.pictures import fit_figures
from abbe.compcore.fitting.reduction import leverage
from abbe.compcore.fitting.renewal import Renewal
from abbe.compcore.fitting.robust import Outlier, reject
from abbe.compcore.fitting.separable import Profile, search
from abbe.compcore.fitting.solution import Solution
from abbe.compcore.fitting.words import (
    fit_words,
    knot_lines,
    parameter_lines,
    parameter_rows,
    rotary_words,
)
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.model import Model
from abbe.compcore.notebook import data_frame, html_table
from abbe.compcore.units import in_digits

if TYPE_CHECKING:
    import pandas as pd


F64 = NDArray[np.float64]
Progress = Callable[[str], None]

_UNCERTAINTY_ROUNDS = 4


@dataclass(frozen=True, eq=False, repr=False)
class FitResult(Solution, Shown):
    """The result of a fit: values, uncertainties, residuals; as text, tables and pictures.

    `model` is the fitted model; `report` the text that ``abbe fit`` prints, `plot` the pictures of
    its page, `to_pandas` all parameters; `knots` what was found for shapes ``spline:auto``;
    `caution` how values are kept from being extrapolated (`cautious.cautiously`), None: not at all;
    `renewal` what was known before (`renewed.renewed`), None: nothing counts but the campaign.
    """

    knots: tuple[KnotChoice, ...] = ()
    caution: Caution | None = None
    renewal: Renewal | None = None

    @property
    def determined(self) -> int:
        """How many combinations of the unknowns the campaign determines by itself."""
        return super().determined if self.caution is None else self.caution.rank

    @property
    def as_weighed(self) -> FitResult:
        """The same in the weights that led to its values: of cautious ones set-up by set-up."""
        if self.caution is None:
            return self
        problem = self.problem.with_sd(self.problem.sd * self.caution.spread)
        return replace(self, problem=problem, weighted=self.weighted / self.caution.spread)

    @cached_property
    def noise(self) -> NoiseFloor:
        """The noise floor of the campaign from its repeated measurements."""
        return noise_floor(self.problem.campaign, self.problem.model.machine)

    def words(self) -> Iterator[str]:
        """Lines as ``abbe fit`` prints: residuals, what is undetermined, outliers, parameters."""
        yield from fit_words(self, self.noise)
        if self.caution is not None:
            yield from self.caution.words()
        if self.renewal is not None:
            yield from self.renewal.words()
        yield from knot_lines(self.knots)
        for line in (*parameter_lines(self), *rotary_words(self)):
            yield f"  {line}"

    def summary(self) -> str:
        """Rows, parameters, residuals and χ² per degree of freedom."""
        rms = self.rms(*LENGTHS)
        left = f"{in_digits(rms * 1e3)} µm rms left, " if np.isfinite(rms) else ""
        return (
            f"{self.problem.n} rows, {len(self.model.terms)} effects with "
            f"{self.problem.layout.model_size} parameters, {left}χ²/dof "
            f"{in_digits(self.chi2_per_dof)}"
        )

    def table(self) -> str:
        """The parameters as an HTML table; effects with more than two parameters by their count."""
        lines = (line.partition(": ") for line in parameter_lines(self))
        return html_table(["effect", "parameters"], [[spec, values] for spec, _, values in lines])

    def figures(self) -> dict[str, Callable[[], Figure]]:
        """The pictures of ``abbe fit --report``, by name."""
        return fit_figures(self)

    def to_pandas(self) -> pd.DataFrame:
        """All parameters as a data frame: effect, parameter, value, sd, unit.

        In the units that people read: µm, µrad, ppm/K.

        Raises
        ------
        AbbeError
            When pandas is not installed.
        """
        rows = parameter_rows(self)
        names = ("effect", "parameter", "value", "sd", "unit")
        return data_frame({name: [row[i] for row in rows] for i, name in enumerate(names)})


def fit(
    model: Model,
    campaign: Campaign,
    *,
    robust: bool = False,
    frame: ReferenceFrame | None = None,
    near: bool = False,
    bodies: Bodies = "asked",
    progress: Progress | None = None,
) -> FitResult:
    """Fit all effects of a model to a campaign.

    Parameters
    ----------
    robust
        Set rows aside that do not belong to the others; they are listed in the result.
    frame
        The reference frame where the measurements leave it open; default least errors.
    near
        Look for time constants, periods and moments only near where the model has values of them;
        everywhere for effects without values. Quicker, where a model has grown by an effect.
    bodies
        Whose beginnings are free; with ``all`` those of every lagged body, expected as far from
        its signal as the model's own values make likely.
    progress
        Told in a few words what is being done.

    Raises
    ------
    FitError
        When the campaign has no rows.
    InputError
        When the frame names axes that the machine lacks, or each row is a set-up of its own.
    """
    require_type(model, Model, "model")
    require_type(campaign, Campaign, "campaign")
    if not campaign.n:
        raise FitError("the campaign has no rows")
    require_rows_together(campaign)
    model, campaign = reaching(model, campaign), steadied(campaign, model.machine)
    frame = ReferenceFrame() if frame is None else frame
    frame.check(model.machine)
    tell = progress or (lambda _: None)
    uncertainty = Uncertainty.of(campaign, model.machine)
    knots: tuple[KnotChoice, ...] = ()
    wide = model
    if any(map(finds_knots, model.effects)):
        tell("finding knots")
        problem = Problem(on_raster(model), campaign, sd=uncertainty.sd)
        with _threads(problem):
            solved = _solved(problem, uncertainty, robust, lambda _: None)
            model, wide, knots = _with_knots(model, *solved)
    result = _result(model, campaign, uncertainty, robust, frame, tell, near, bodies)
    if not knots:
        return result
    tell("how sure the knots are")
    wider = _result(wide, campaign, uncertainty, robust, frame, lambda _: None)
    return replace(result, model=widened(result.model, wider.model), knots=knots)


def _result(
    model: Model, campaign: Campaign, uncertainty: Uncertainty, robust: bool,
    frame: ReferenceFrame, tell: Progress, near: bool = False, bodies: Bodies = "asked",
) -> FitResult:  # fmt: skip
    problem = Problem(model, campaign, sd=uncertainty.sd, bodies=bodies)
    if bodies == "all":
        problem.expect_starts(problem.layout.of_model(model, campaign))
    with _threads(problem):
        solved, theta, decomposition, uncertainty, aside = _solved(
            problem, uncertainty, robust, tell, near
        )
        tell("what is not determined")
        return FitResult.of(solved, theta, decomposition, frame, uncertainty, aside)


_Solved = tuple[Problem, F64, Decomposition, Uncertainty, tuple[Outlier, ...]]


def _threads(problem: Problem) -> AbstractContextManager[None]:
    rows = min(problem.n, rows_at_once(problem.layout.size))
    return threads_for(rows * problem.layout.size)


def _with_knots(
    model: Model, problem: Problem, theta: F64, decomposition: Decomposition, _: Uncertainty,
    aside: tuple[Outlier, ...],
) -> tuple[Model, Model, tuple[KnotChoice, ...]]:  # fmt: skip
    """The knots of the shapes that ask for them, from the fit on the raster."""
    eliminator = problem.eliminator(theta)
    left = eliminator.project(problem.residual(theta))
    dof = problem.n - len(aside) - eliminator.rank - decomposition.rank
    return with_knots(model, problem, theta, float(left @ left), dof)


def _solved(
    problem: Problem, uncertainty: Uncertainty, robust: bool, tell: Progress, near: bool = False
) -> _Solved:
    """The solution in any frame, what of it is determined, and what was set aside."""
    theta = problem.start()
    if problem.layout.searched:
        tell("searching time constants, periods and moments")
        theta = _nearby(problem, theta) if near else _searched(problem, theta)
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
    return problem, theta, decomposition, uncertainty, set_aside


def _searched(problem: Problem, theta: F64) -> F64:
    """θ with the best non-linear parameters, found from everywhere and from the model's own.

    So an effect more never leads to a worse fit: the search may begin where the model without it
    stood.
    """
    own = problem.layout.of_model(problem.model, problem.campaign)
    at = list(problem.layout.searched)
    found = search(problem, theta)
    if np.array_equal(own[at], theta[at]):
        return found
    here = theta.copy()
    here[at] = own[at]
    profile = Profile(problem, theta)
    return min(
        (found, search(problem, problem.layout.within(here))), key=lambda t: profile.cost(t[at])
    )


def _nearby(problem: Problem, theta: F64) -> F64:
    """θ with the best non-linear parameters near the model's own; found where it has none."""
    layout = problem.layout
    own = layout.of_model(problem.model, problem.campaign)
    at = list(layout.searched)
    here = theta.copy()
    here[at] = own[at]
    new = [i for i, term in enumerate(problem.model.terms) if not term.fitted]
    return search(problem, layout.within(here), only=new)


def _with_uncertainty(
    problem: Problem, theta: F64, uncertainty: Uncertainty
) -> tuple[Problem, F64, Decomposition, Uncertainty]:
    """The solution, and the uncertainties that no row states, found together."""
    origin = theta
    theta, decomposition = gauss_newton(problem, theta)
    if uncertainty.open:
        for _ in range(_UNCERTAINTY_ROUNDS):
            raw = problem.residual(theta)
            left = problem.eliminator(theta).project(raw) * problem.sd
            absorbed = leverage(problem, theta, decomposition)
            uncertainty = uncertainty.updated(problem.campaign, left, absorbed)
            problem = problem.with_sd(uncertainty.sd)
            theta, decomposition = gauss_newton(problem, theta, origin=origin)
    return problem, theta, decomposition, uncertainty
