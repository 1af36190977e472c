"""The comparison: a model beside measurements, nothing fitted but placings and runs' beginnings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import LENGTHS, Campaign, Kind
from abbe.compcore.campaign.noise import NoiseFloor, noise_floor
from abbe.compcore.campaign.set_ups_of_one_row import require_rows_together
from abbe.compcore.campaign.steady_thermometers import steadied
from abbe.compcore.campaign.suspicions import of_campaign, of_chi2, of_ratio, of_signals, of_values
from abbe.compcore.comparison.approach import (
    SideDifference,
    by_side_and_component,
    side_differences,
)
from abbe.compcore.comparison.lines import MeasuredLine, lines
from abbe.compcore.comparison.parts import ComparedRows, Mask, Point
from abbe.compcore.comparison.pictures import line_figure, part_figures
from abbe.compcore.comparison.tabulate import ResidualGroup, group, tables
from abbe.compcore.comparison.words import (
    clock_words,
    comparison_words,
    fitted_note,
    known_waves,
)
from abbe.compcore.distributions import chi2_limit
from abbe.compcore.effects.base import Effect
from abbe.compcore.errors import FitError, require_type
from abbe.compcore.figures.figure import Figure
from abbe.compcore.figures.shown import Shown
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.design.row_blocks import rows_at_once
from abbe.compcore.fitting.design.run_starts import Bodies
from abbe.compcore.fitting.design.weights import Uncertainty
from abbe.compcore.fitting.gauss_newton import gauss_newton
from abbe.compcore.fitting.reduction import leverage
from abbe.compcore.fitting.words import start_lines
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.days import of_another_day
from abbe.compcore.model.extrapolated import extrapolated_words
from abbe.compcore.model.measured_ranges import OutsideMeasured, signals_outside
from abbe.compcore.model.model import Model
from abbe.compcore.notebook import html_table
from abbe.compcore.sentences import counted, joined, said
from abbe.compcore.units import in_digits

if TYPE_CHECKING:
    import pandas as pd

F64 = NDArray[np.float64]

_UNCERTAINTY_ROUNDS = 4
_MISFIT = 1e-4
"""Chance of so large a χ² from which on the model is said not to hold."""
_NOTHING_LEFT = 0.5
"""Degrees of freedom from which down nothing is left over."""
WORST = 10
"""How many of the worst points are listed."""


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Shown):
    """A model beside a campaign.

    Attributes
    ----------
    problem, theta
        What was compared (`Problem`), and the values: the model's, with base points, tools and
        how warm lagged bodies began fitted.
    residual, weighted
        Measured − predicted − nuisances, (n,): mm or rad, and in units of sd.
    measured
        Measured − nuisances as if the model predicted nothing, (n,): the error before the model,
        mm or rad; for distances the same as `residual`.
    lengths, rotations
        Displacements and distances; rotations.
    lines
        Straight lines with their linear part and the rest.
    noise
        What repeated measurements say.
    uncertainty
        The rows' standard uncertainties and where they come from.
    left_out
        Specs of instrument effects that belong to other set-ups than this campaign's.
    other_day, same_day
        Specs of what ran by the clock of another day, and is left out; and of what is applied as
        if this were the same day, as no date says which it is.
    changed
        What has changed since the model was fitted, in sentences; empty where nobody asked.
    diagnosing
        What to call, or to type, next.
    """

    problem: Problem
    theta: F64
    residual: F64
    weighted: F64
    measured: F64
    lengths: ComparedRows
    rotations: ComparedRows
    lines: list[MeasuredLine]
    noise: NoiseFloor
    uncertainty: Uncertainty
    left_out: tuple[str, ...]
    other_day: tuple[str, ...] = ()
    same_day: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    diagnosing: str = "abbe.diagnose(model, campaign)"

    @property
    def fitted_files(self) -> tuple[str, ...]:
        """Those of the campaign's files to which the model was fitted, by their SHA-256."""
        known = self.problem.model.fitted_to
        files = self.problem.campaign.files
        return tuple(file for file, sha256 in files.items() if sha256 in known)

    @cached_property
    def extrapolated(self) -> tuple[Mask, tuple[OutsideMeasured, ...]]:
        """Rows (n,) whose signals were not so when the model was fitted, and which of them."""
        return signals_outside(self.problem.model, self.problem.campaign.conditions)

    def inside_and_out(self, part: ComparedRows) -> tuple[float, float]:
        """RMS of what is left of a part where signals were as fitted, and where not, mm or rad."""
        out = self.extrapolated[0]
        left = (self.residual[part.rows & ~out], self.residual[part.rows & out])
        inside, outside = (float(np.sqrt(np.mean(r**2))) if r.size else math.nan for r in left)
        return inside, outside

    @cached_property
    def suspicions(self) -> tuple[str, ...]:
        """Wrong units, turned signs, absurd uncertainties, as far as they can be seen here."""
        campaign = self.problem.campaign
        weight = self.problem.weight
        stated = not self.uncertainty.open
        repeats = not np.isfinite(campaign.sd).any()
        found = [
            *of_campaign(campaign, self.problem.model.machine),
            *of_values(campaign, self.measured),
            *of_signals(campaign, self.problem.model.machine, self.problem.model.measured_signals),
            *of_ratio(campaign, self.measured, self.measured - self.residual, weight),
        ]
        for part, what, _, _ in self._parts():
            found += of_chi2(
                part.chi2_per_dof, part.n, stated=stated, repeats=bool(repeats), what=what
            )
        return tuple(found)

    @property
    def holds(self) -> bool:
        """Whether what is left is noise: χ² no larger than 1 in 10 000 by chance, of any kind."""
        return not any(
            part.n and part.chi2_per_dof > chi2_limit(_MISFIT, part.freedom) / part.freedom
            for part, _, _, _ in self._parts()
            if part.freedom > 0.5
        )

    def estimated(self, part: ComparedRows) -> bool:
        """Whether a part's uncertainty is made of what is left of it: its χ² then says nothing."""
        angles = part is self.rotations
        return "residuals" in {
            source
            for kind, source in self.uncertainty.source.items()
            if (kind == Kind.ROTATION) == angles
        }

    @cached_property
    def sides(self) -> list[SideDifference]:
        """What differs between the two sides from which an axis came, the largest first."""
        problem = self.problem
        upright = problem.model.machine.structure.upright
        return side_differences(problem.campaign, self.residual, problem.weight, upright)

    def by_side(self, part: ComparedRows) -> list[ResidualGroup]:
        """Residuals by side of approach and measured component, in µm or µrad."""
        factor = 1e6 if part is self.rotations else 1e3
        return [
            group(of, self.residual[mask] * factor)
            for of, mask in by_side_and_component(self.problem.campaign, part.rows)
        ]

    def verdict(self) -> Iterator[str]:
        """Whether the model holds, what stands out, and the next command."""
        parts = joined(
            said("{what} are off by {size} {unit} rms", **off)
            if self.estimated(part)
            else said(
                "{what} are off by {size} {unit} rms (χ²/dof {chi2})",
                **off,
                chi2=in_digits(part.chi2_per_dof),
            )
            for part, name, unit, factor in self._parts()
            if part.n
            for off in [{"what": name, "size": in_digits(part.rms * factor), "unit": unit}]
        )
        if self.uncertainty.open:
            yield said(
                "Whether this is noise is open: the campaign states no uncertainty, and too little "
                "was measured twice; {parts}.",
                parts=parts,
            )
        elif self.holds:
            yield said("The model holds: what is left is noise; {parts}.", parts=parts)
            yield from self._extrapolated_words()
            return
        else:
            yield said("THE MODEL DOES NOT HOLD on this campaign: {parts}.", parts=parts)
        yield from self.changed
        yield from self._extrapolated_words()
        for side in self.sides:
            yield said(
                "{what}: {share} of what is left.", what=side.words, share=f"{side.share:.0%}"
            )
        yield f"next: {self.diagnosing}"

    def _extrapolated_words(self) -> Iterator[str]:
        out, beyond = self.extrapolated
        if beyond:
            sizes = [
                (inside * factor, outside * factor, unit)
                for part, _, unit, factor in self._parts()
                for inside, outside in [self.inside_and_out(part)]
            ]
            yield extrapolated_words(beyond, float(out.mean()), sizes)

    def words(self) -> Iterator[str]:
        """What ``abbe compare`` prints: overall, worst set-ups and regions, worst points, lines."""
        for suspicion in self.suspicions:
            yield f"SUSPICIOUS: {suspicion}"
        if files := self.fitted_files:
            yield fitted_note(files)
        yield from self.verdict()
        yield from start_lines(self.problem, self.theta)
        yield from clock_words(self.other_day, self.same_day)
        yield from comparison_words(
            self.problem.campaign,
            self.lengths,
            self.rotations,
            self.lines,
            self.noise,
            self.left_out,
            known_waves(self.problem.model),
        )

    def summary(self) -> str:
        """Rows, rms and χ² per degree of freedom."""
        reported = [
            said(
                "{n} {what}, {rms} rms, χ²/dof {chi2}",
                n=part.n,
                what=name,
                rms=f"{in_digits(part.rms * factor)} {unit}",
                chi2=in_digits(part.chi2_per_dof),
            )
            for part, name, unit, factor in self._parts()
            if part.n
        ]
        return joined(reported) if reported else ""

    def _parts(self) -> tuple[tuple[ComparedRows, str, str, float], ...]:
        return (
            (self.lengths, said("lengths"), "µm", 1e3),
            (self.rotations, said("rotations"), "µrad", 1e6),
        )

    def table(self) -> str:
        """The set-ups, worst first, in HTML."""
        rows = [
            [" ".join(str(v) for v in group.of.values()), unit, group.n, group.rms, group.max]
            for part, _, unit, _ in self._parts()
            for group in sorted(part.tables.setups, key=lambda g: -g.rms)
        ]
        return html_table(["set-up", "unit", "rows", "rms", "largest"], rows)

    def figures(self) -> dict[str, Callable[[], Figure]]:
        """The pictures of ``abbe compare --report`` by name."""
        campaign, machine = self.problem.campaign, self.problem.model.machine
        return {
            **part_figures(
                self.lengths, "residuals", campaign, self.residual, self.weighted, machine
            ),
            **part_figures(
                self.rotations, "rotations", campaign, self.residual, self.weighted, machine
            ),
            **line_figure(self.lines),
        }

    def to_pandas(self) -> pd.DataFrame:
        """The residuals as a data frame: the campaign's columns, what was measured, what is left.

        Further columns beside those of `Campaign.to_pandas`: ``before``, ``residual``, mm or rad,
        and ``weighted``, in units of the standard uncertainty.

        Raises
        ------
        AbbeError
            When pandas is not installed.
        """
        table = self.problem.campaign.to_pandas()
        return table.assign(before=self.measured, residual=self.residual, weighted=self.weighted)


def compare(model: Model, campaign: Campaign) -> Comparison:
    """Lay a model beside a campaign.

    Only what the placing of the instruments leaves unknown is fitted: set-ups' nuisances, base
    points, tools; and how warm lagged bodies were when each run began. Effects of the instrument
    that belong to one set-up or base point count only on the campaign to which they were fitted.

    Raises
    ------
    FitError
        When the campaign has no rows, or the placings of the instruments take up all of them.
    InputError
        When each row is a set-up of its own.
    """
    require_type(model, Model, "model")
    require_type(campaign, Campaign, "campaign")
    if not campaign.n:
        raise FitError("the campaign has no rows")
    require_rows_together(campaign)
    campaign = steadied(campaign, model.machine)
    seen_in_fit = model.seen(campaign.files.values())
    left_out = () if seen_in_fit else tuple(e.spec for e in model.effects if bound_to_setup(e))
    applied = model if seen_in_fit else _without(model, bound_to_setup)
    clock = [e for e in model.effects if e.of_its_day()] if not seen_in_fit else []
    another = of_another_day(model, campaign) if clock else False
    if another:
        applied = _without(applied, lambda e: e.of_its_day())
    uncertainty = Uncertainty.of(campaign, model.machine)
    # how warm bodies were when another run began the fit does not say
    bodies: Bodies = "asked" if seen_in_fit else "all"
    problem = Problem(applied, campaign, sd=uncertainty.sd, bodies=bodies)
    if not seen_in_fit:
        problem.expect_starts(problem.layout.of_model(applied, campaign))
    share = float(model.fit.get("determined", 0)) / campaign.n if seen_in_fit else 0.0
    with threads_for(min(problem.n, rows_at_once(problem.layout.size)) * problem.layout.size):
        found = _compared(problem, applied, uncertainty, share, left_out)
    specs = tuple(e.spec for e in clock)
    return replace(
        found, other_day=specs if another else (), same_day=specs if another is None else ()
    )


def _compared(
    problem: Problem,
    applied: Model,
    uncertainty: Uncertainty,
    share: float,
    left_out: tuple[str, ...],
) -> Comparison:
    campaign = problem.campaign
    theta = problem.layout.of_model(applied, campaign)
    placed = np.arange(problem.layout.model_size, problem.layout.size)
    for _ in range(_UNCERTAINTY_ROUNDS if uncertainty.open else 1):
        free = placed
        while free.size:
            theta, decomposition = gauss_newton(problem, theta, free)
            theta, ends = problem.believable(theta)
            if not np.isin(free, ends).any():
                break
            free = np.setdiff1d(free, ends)
        misfit = campaign.value - problem.predicted(theta)
        if free.size:
            absorbed = leverage(problem, theta, decomposition, free)
        else:
            absorbed = problem.eliminator(theta).leverage(campaign.n)
        if uncertainty.open:
            left = problem.eliminator(theta).project(misfit * problem.weight) * problem.sd
            uncertainty = uncertainty.updated(campaign, left, absorbed)
            problem = problem.with_sd(uncertainty.sd)
    if campaign.n - float(absorbed.sum()) <= _NOTHING_LEFT:
        raise FitError(
            said(
                "the placings of the instruments take up all that was measured ({rows}): nothing "
                "is left over that a model could be compared with; measure more",
                rows=counted(campaign.n, "1 row", "{n} rows"),
            )
        )
    eliminator = problem.eliminator(theta)
    weighted = eliminator.project(misfit * problem.weight)
    residual = weighted * problem.sd
    displacement = (campaign.kind < Kind.DISTANCE).astype(np.float64)
    unmodelled = eliminator.project(campaign.value * displacement * problem.weight) * problem.sd
    measured = np.where(campaign.kind < Kind.DISTANCE, unmodelled, residual)
    length = np.isin(campaign.kind, LENGTHS)
    return Comparison(
        problem,
        theta,
        residual,
        weighted,
        measured,
        _part(problem, residual, weighted, absorbed + share, length),
        _part(problem, residual, weighted, absorbed + share, ~length),
        lines(campaign, residual, eliminator),
        noise_floor(campaign, applied.machine),
        uncertainty,
        left_out,
    )


def bound_to_setup(effect: Effect) -> bool:
    """Whether an effect of the instrument belongs to one placing of it, not to every campaign."""
    named = any(getattr(effect, key, None) for key in ("setup", "setups", "base"))
    return effect.scope == "instrument" and named


def _without(model: Model, which: Callable[[Effect], bool]) -> Model:
    # without values they predict nothing
    terms = tuple(replace(t, values={}) if which(t.effect) else t for t in model.terms)
    return replace(model, terms=terms, covariance=None)


def _part(
    problem: Problem, residual: F64, weighted: F64, absorbed: F64, rows: Mask
) -> ComparedRows:
    campaign = problem.campaign
    size = np.abs(residual[rows])
    freedom = float((1.0 - absorbed[rows]).sum())
    chi2 = float(weighted[rows] @ weighted[rows])
    unit = 1e6 if (campaign.kind[rows] == Kind.ROTATION).any() else 1e3
    worst = np.flatnonzero(rows)[np.argsort(-size, kind="stable")[:WORST]]
    setup = campaign.conditions.setup
    nothing = float("nan")
    return ComparedRows(
        rows,
        float(np.sqrt(np.mean(size**2))) if size.size else nothing,
        float(size.max()) if size.size else nothing,
        float(np.quantile(size, 0.95)) if size.size else nothing,
        chi2 / freedom if freedom > 0.5 else nothing,
        freedom,
        tables(problem.model.machine, campaign, residual * unit, rows),
        tuple(
            Point(
                int(i),
                int(campaign.line[i]),
                "" if setup is None else str(setup[i]),
                float(residual[i]),
                float(problem.sd[i]),
            )
            for i in worst
        ),
    )
