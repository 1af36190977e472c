"""The text of a fit; lengths in µm, angles in µrad."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import LENGTHS, Kind
from abbe.compcore.campaign.noise import NoiseFloor
from abbe.compcore.fitting.cancelling import cancel_lines
from abbe.compcore.fitting.design.begun import begun
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.detail import finer, no_finer_than_seen
from abbe.compcore.fitting.knots.choice import KnotChoice
from abbe.compcore.fitting.rigid_body import rigid_body_test
from abbe.compcore.fitting.solution import Solution
from abbe.compcore.fitting.undetermined.words import Undetermined
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.as_built import ON_THE_TABLE, reversed_parameters
from abbe.compcore.model.course import runs_away
from abbe.compcore.model.held_spindle import tool_of
from abbe.compcore.model.model import Model
from abbe.compcore.model.to_enter import average_line_words
from abbe.compcore.model.told import not_told, untold
from abbe.compcore.sentences import counted, joined, listed, said
from abbe.compcore.units import display, in_digits, read_in, with_uncertainty

_KINDS = {
    Kind.DISPLACEMENT: said("displacement"),
    Kind.ROTATION: said("rotation"),
    Kind.DISTANCE: said("distance"),
    Kind.BASE_DISTANCE: said("base distance"),
}
_MOST_LISTED = 20
_NOTHING = 1e-9
"""A standard uncertainty below this part of what is believable belongs to a convention."""
FLEXES = 0.01
"""Corrected p-value below which a machine counts as not rigid."""
_OFF = 2.0
"""Standard uncertainties from which on a gauge is named."""
_NAMED = 5
_SOURCES = {
    "stated": said("as stated in the campaign"),
    "replicates": said("from repeated measurements, as the campaign states none"),
    "residuals": said(
        "from what the fit leaves over, as the campaign states none: χ²/dof tells nothing"
    ),
}
_MOST_UNDETERMINED = 8
"""Combinations that are not determined that are listed; the rest are counted."""


def gauge_words(gauges: Mapping[str, float]) -> Iterator[str]:
    """What the rows say of the gauges that they were measured against."""
    if not gauges:
        return
    off = {name: amount for name, amount in gauges.items() if abs(amount) > _OFF}
    yield said(
        "gauges whose calibration's uncertainty their rows have in common: {all}, {off} of them "
        "off by more than {limit} standard uncertainties",
        all=len(gauges), off=len(off) or said("none"), limit=f"{_OFF:g}",
    )  # fmt: skip
    for name, amount in sorted(off.items(), key=lambda item: -abs(item[1]))[:_NAMED]:
        yield said(
            "gauge {name}: its rows say that it is off by {times} times its standard uncertainty: "
            "was it clean, was its temperature right, has it been dropped?",
            name=name, times=f"{abs(amount):.1f}",
        )  # fmt: skip


def start_lines(problem: Problem, theta: NDArray[np.float64]) -> Iterator[str]:
    """How far lagged bodies were from their signals when each run began."""
    for found in begun(problem, theta):
        line = said(
            "at first, in {file}: {spec}: {apart} off equilibrium with {signal}",
            file=found.file, spec=found.spec, signal=found.signal,
            apart=listed([f"{in_digits(value, sign=True)} {found.unit}" for value in found.off]),
        )  # fmt: skip
        if not found.plausible:
            line = said(
                "{line}: IMPLAUSIBLE, at most some {most} can be: something else moved the "
                "machine, or the effect hardly does",
                line=line, most=f"{in_digits(found.furthest, 2)} {found.unit}",
            )  # fmt: skip
        yield line


def too_fine_lines(problem: Problem) -> Iterator[str]:
    """Curves with more coefficients than the campaign shows them places, and what to take."""
    machine, conditions = problem.model.machine, problem.campaign.conditions
    for effect in problem.model.effects:
        smoother = no_finer_than_seen(effect, conditions, machine)
        if smoother is effect:
            continue
        tables = [d for d in finer(smoother, conditions, machine) if d.get("shape") == "table"]
        taken = smoother.model_copy(update=tables[0]) if tables else smoother
        yield said(
            "TOO FINE: {spec}: {axis} was read at too few places for {count} coefficients; between "
            "them it says what nobody measured. Better, with abbe add: {better}",
            spec=effect.spec, axis=str(getattr(effect, "axis", "")),
            count=len(effect.linear(machine)), better=taken.spec,
        )  # fmt: skip


def run_away_lines(model: Model, conditions: Conditions) -> Iterator[str]:
    """Curves that say much more where nobody measured than where somebody did."""
    for term in model.terms:
        axis = getattr(term.effect, "axis", "")
        if axis not in conditions.positions:
            continue
        found = runs_away(term, model.machine, conditions.position(axis))
        if found is None:
            continue
        unit, factor = ("µrad", 1e6) if found.angle else ("µm", 1e3)
        turn, mm = (math.degrees(1.0), "°") if model.machine.axis(axis).rotary else (1.0, " mm")
        yield said(
            "RUNS AWAY: {spec} is {away} off at {axis} {place}, where nobody measured; where it "
            "was measured it stays within {read}. Measure there, or take a table or fewer "
            "coefficients, before tables are made of it",
            spec=found.effect, axis=axis,
            away=f"{in_digits(found.away * factor, sign=True)} {unit}",
            place=f"{in_digits(found.place * turn, 4)}{mm}",
            read=f"{in_digits(found.read * factor)} {unit}",
        )  # fmt: skip


def fit_words(result: Solution, noise: NoiseFloor) -> Iterator[str]:
    """Lines of text about a fit, without its parameters."""
    problem = result.problem
    layout = problem.layout
    for suspicion in result.suspicions:
        yield said("SUSPICIOUS: {what}", what=suspicion)
    yield said(
        "{rows} of {setups}; {effects} with {parameters}, {rank} of them determined; {unknowns}",
        rows=counted(problem.n, "1 row", "{n} rows"),
        setups=counted(len(problem.campaign.setups), "1 set-up", "{n} set-ups"),
        effects=counted(len(problem.model.terms), "1 effect", "{n} effects"),
        parameters=counted(layout.model_size, "1 parameter", "{n} parameters"),
        rank=counted(result.determined, "1 combination", "{n} combinations"),
        unknowns=counted(
            result.eliminator.rank, "1 unknown of the set-ups", "{n} unknowns of the set-ups"
        ),
    )  # fmt: skip
    for kinds, name, factor, unit in (
        (LENGTHS, said("lengths"), 1e3, "µm"),
        ((Kind.ROTATION,), said("rotations"), 1e6, "µrad"),
    ):
        rms = result.rms(*kinds)
        if math.isfinite(rms):
            size = f"{in_digits(rms * factor)} {unit}"
            yield said("residuals of {kind}: {size} rms", kind=name, size=size)
    yield said(
        "χ² per degree of freedom: {chi2} ({dof})",
        chi2=f"{result.chi2_per_dof:.3f}", dof=result.dof,
    )  # fmt: skip
    for kind, source in result.uncertainty.source.items():
        yield said(
            "uncertainty of each {kind}: {source}", kind=_KINDS[kind], source=_SOURCES[source]
        )
    yield from gauge_words(result.gauges)
    yield from start_lines(problem, result.theta)
    if result.frame.tool is not None:
        offset = ", ".join(f"{v:g}" for v in result.frame.tool)
        yield said(
            "frame by {first} and {second} through the middle of the volume, tool ({offset}) mm",
            first=result.frame.primary, second=result.frame.secondary, offset=offset,
        )  # fmt: skip
    yield from noise.words()
    yield from undetermined_lines(result.undetermined)
    yield from too_fine_lines(problem)
    yield from run_away_lines(result.model, problem.campaign.conditions)
    yield from cancel_lines(result)
    for test in rigid_body_test(result):
        if test.adjusted < FLEXES:
            by = test.by
            for other in test.alike:
                by = said("{this}, or {other}", this=by, other=other)
            yield said(
                "NOT RIGID: {motion} depends on {by} (p = {p}, {size} rms)",
                motion=test.motion, by=by, p=in_digits(test.adjusted, 1),
                size=f"{in_digits(test.rms * 1e3, 2)} µm",
            )  # fmt: skip
            break
    if result.outliers and result.misfit and not result.set_aside:
        yield said(
            "{rows} out, but χ² says that the model lacks something rather than that rows are "
            "wrong: see `abbe diagnose`",
            rows=counted(len(result.outliers), "1 row stands", "{n} rows stand"),
        )
        return
    reported = said("set aside") if result.set_aside else said("used; --robust would set it aside")
    for outlier in result.outliers[:_MOST_LISTED]:
        value = outlier.residual * _factor(result, outlier.row)
        unit = "µrad" if problem.campaign.kind[outlier.row] == Kind.ROTATION else "µm"
        yield said(
            "outlier: {file}, line {line}, set-up {setup}: {size}, {times} standard deviations "
            "({reported})",
            file=problem.campaign.file_of(outlier.row), line=outlier.line, setup=outlier.setup,
            size=f"{in_digits(value, sign=True)} {unit}", times=f"{outlier.size:.1f}",
            reported=reported,
        )  # fmt: skip
    if len(result.outliers) > _MOST_LISTED:
        more = len(result.outliers) - _MOST_LISTED
        yield said("and {n} more outliers; --json lists them all", n=more)


def undetermined_lines(found: Sequence[Undetermined]) -> Iterator[str]:
    """What a campaign does not show: effects that it shows nothing of in one line, some others."""
    alone = list(dict.fromkeys(one.alone for one in found if one.alone))
    if len(alone) > 1:
        text = said(
            "{what}: this campaign does not show them (left at the value of least norm); "
            "predictions that need them are uncertain by their whole plausible range",
            what=joined(alone, ", "),
        )
        yield said("NOT DETERMINED: {what}", what=text)
    rest = [one for one in found if not one.convention and (len(alone) < 2 or not one.alone)]
    for one in rest[:_MOST_UNDETERMINED]:
        yield said("NOT DETERMINED: {what}", what=one.text)
    if (more := len(rest) - _MOST_UNDETERMINED) > 0:
        yield said(
            "NOT DETERMINED: {n} more combinations of these and others; --json lists them all",
            n=more,
        )
    for one in found:
        if one.convention:
            yield said("convention: {what}", what=one.text)


def knot_lines(knots: Iterable[KnotChoice]) -> Iterator[str]:
    """How many knots each ``spline:auto`` got, where, and how sure that is."""
    for found in knots:
        places = ", ".join(
            f"{in_digits(q, 4)} ± {in_digits(s, 2)}"
            for q, s in zip(found.knots, found.spread, strict=True)
        )
        chances = ", ".join(f"{k}: {p:.0%}" for k, p in found.probability.items() if p >= 0.005)
        unit, factor = display(found.unit)
        count: object = len(found.knots)
        if found.knots:
            count = said("{n} at {places}", n=count, places=f"{places} {found.where}")
        yield said(
            "knots of {effect}: {count} (how many, by evidence: {chances}; other choices move the "
            "curve by ±{size})",
            effect=found.effect, count=count, chances=chances,
            size=f"{in_digits(found.curve_sd * factor, 2)} {unit}",
        )  # fmt: skip


def parameter_lines(result: Solution) -> Iterator[str]:
    """Effects of one or two parameters with value ± standard uncertainty; shapes by their count."""
    for i, term in enumerate(result.model.terms):
        if len(term.values) > 2:
            count = said("{n} coefficients", n=len(term.values))
            yield said("{spec}: {values}", spec=term.effect.spec, values=count)
            continue
        parts: list[str] = []
        layout = result.problem.layout
        unknowns = layout.unknowns[layout.terms[i]]
        nothing = untold(term.effect, result.model.machine)
        for (name, value), unknown in zip(term.values.items(), unknowns, strict=True):
            shown, factor = read_in(unknown)
            sd = 0.0 if value.sd is None else value.sd
            if not_told(value, nothing.get(name, 0.0)):
                parts.append(said("{name} not measured", name=name))
                continue
            if sd < _NOTHING * unknown.scale:
                size = f"{name} = {in_digits(value.value * factor, 4)} {shown}"
                parts.append(said("{value}, by convention", value=size))
                continue
            text = f"{name} = {with_uncertainty(value.value * factor, sd * factor)} {shown}"
            if name in reversed_parameters(result.model.machine, term.effect):
                there = in_digits(-value.value * factor, 4, sign=True)
                text = said(
                    "{value} (on the table itself {there})", value=text, there=f"{there} {shown}"
                )
            parts.append(text)
        yield said("{spec}: {values}", spec=term.effect.spec, values=joined(parts, ", "))


def rotary_words(result: Solution) -> Iterator[str]:
    """Lines about rotary axes' average lines, and about signs when measured on a table."""
    yield from average_line_words(result.model, tool_of(result.problem.campaign))
    if any(reversed_parameters(result.model.machine, e) for e in result.model.effects):
        yield ON_THE_TABLE


def parameter_rows(result: Solution) -> list[tuple[str, str, float, float | None, str]]:
    """All parameters: effect, parameter, value, standard uncertainty, unit that people read."""
    layout = result.problem.layout
    rows = []
    for term, where in zip(result.model.terms, layout.terms, strict=True):
        for (name, value), unknown in zip(term.values.items(), layout.unknowns[where], strict=True):
            unit, factor = read_in(unknown)
            sd = None if value.sd is None else value.sd * factor
            rows.append((term.effect.spec, name, value.value * factor, sd, unit))
    return rows


def _factor(result: Solution, row: int) -> float:
    return 1e6 if result.problem.campaign.kind[row] == Kind.ROTATION else 1e3
