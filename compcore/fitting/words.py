"""The text of a fit; lengths in µm, angles in µrad."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import LENGTHS, Kind
from abbe.compcore.campaign.noise import NoiseFloor
from abbe.compcore.fitting.design.begun import begun
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.knots.choice import KnotChoice
from abbe.compcore.fitting.rigid_body import rigid_body_test
from abbe.compcore.fitting.solution import Solution
from abbe.compcore.model.as_built import (
    ON_THE_TABLE,
    average_line_words,
    reversed_parameters,
)
from abbe.compcore.units import display, in_digits, read_in, with_uncertainty

_MOST_LISTED = 20
_NOTHING = 1e-9
"""A standard uncertainty below this part of what is believable belongs to a convention."""
FLEXES = 0.01
"""Corrected p-value below which a machine counts as not rigid."""
_OFF = 2.0
"""Standard uncertainties from which on a gauge is named."""
_NAMED = 5
_SOURCES = {
    "stated": "as stated in the campaign",
    "replicates": "from repeated measurements, as the campaign states none",
    "residuals": "from what the fit leaves over, as the campaign states none: χ²/dof tells nothing",
}


def gauge_words(gauges: Mapping[str, float]) -> Iterator[str]:
    """What the rows say of the gauges that they were measured against."""
    if not gauges:
        return
    off = {name: amount for name, amount in gauges.items() if abs(amount) > _OFF}
    yield (
        f"gauges whose calibration's uncertainty their rows have in common: {len(gauges)}, "
        f"{len(off) or 'none'} of them off by more than {_OFF:g} standard uncertainties"
    )
    for name, amount in sorted(off.items(), key=lambda item: -abs(item[1]))[:_NAMED]:
        yield (
            f"gauge {name}: its rows say that it is off by {abs(amount):.1f} times its standard "
            "uncertainty: was it clean, was its temperature right, has it been dropped?"
        )


def start_lines(problem: Problem, theta: NDArray[np.float64]) -> Iterator[str]:
    """How far lagged bodies were from their signals when each run began."""
    for found in begun(problem, theta):
        apart = " and ".join(f"{in_digits(value, sign=True)} {found.unit}" for value in found.off)
        line = (
            f"at first, in {found.file}: {found.spec}: {apart} off equilibrium with {found.signal}"
        )
        if not found.plausible:
            line += (
                f": IMPLAUSIBLE, at most some {in_digits(found.furthest, 2)} {found.unit} "
                "can be: something else moved the machine, or the effect hardly does"
            )
        yield line


def fit_words(result: Solution, noise: NoiseFloor) -> Iterator[str]:
    """Lines of text about a fit, without its parameters."""
    problem = result.problem
    layout = problem.layout
    for suspicion in result.suspicions:
        yield f"SUSPICIOUS: {suspicion}"
    yield (
        f"{problem.n} rows of {len(problem.campaign.setups)} set-ups; "
        f"{len(problem.model.terms)} effects with {layout.model_size} parameters, "
        f"{result.decomposition.rank} combinations of them determined; "
        f"{result.eliminator.rank} unknowns of the set-ups"
    )
    for kinds, name, factor, unit in (
        (LENGTHS, "lengths", 1e3, "µm"),
        ((Kind.ROTATION,), "rotations", 1e6, "µrad"),
    ):
        rms = result.rms(*kinds)
        if math.isfinite(rms):
            yield f"residuals of {name}: {in_digits(rms * factor)} {unit} rms"
    yield f"χ² per degree of freedom: {result.chi2_per_dof:.3f} ({result.dof})"
    for kind, source in result.uncertainty.source.items():
        yield f"uncertainty of each {kind.name.lower().replace('_', ' ')}: {_SOURCES[source]}"
    yield from gauge_words(result.gauges)
    yield from start_lines(problem, result.theta)
    if result.frame.tool is not None:
        offset = ", ".join(f"{v:g}" for v in result.frame.tool)
        yield (
            f"frame by {result.frame.primary} and {result.frame.secondary} through the middle of "
            f"the volume, tool ({offset}) mm"
        )
    yield str(noise)
    for found in result.undetermined:
        yield ("convention: " if found.convention else "NOT DETERMINED: ") + found.text
    for test in rigid_body_test(result):
        if test.adjusted < FLEXES:
            alike = "".join(f", or {other}" for other in test.alike)
            yield (
                f"NOT RIGID: {test.motion} depends on {test.by}{alike} "
                f"(p = {in_digits(test.adjusted, 1)}, {in_digits(test.rms * 1e3, 2)} µm rms)"
            )
            break
    if result.outliers and result.misfit and not result.set_aside:
        yield (
            f"{len(result.outliers)} rows stand out, but χ² says that the model lacks something "
            "rather than that rows are wrong: see `abbe diagnose`"
        )
        return
    reported = "set aside" if result.set_aside else "used; --robust would set it aside"
    for outlier in result.outliers[:_MOST_LISTED]:
        value = outlier.residual * _factor(result, outlier.row)
        unit = "µrad" if problem.campaign.kind[outlier.row] == Kind.ROTATION else "µm"
        yield (
            f"outlier: {problem.campaign.file_of(outlier.row)}, line {outlier.line}, "
            f"set-up {outlier.setup}: {in_digits(value, sign=True)} {unit}, "
            f"{outlier.size:.1f} standard deviations ({reported})"
        )
    if len(result.outliers) > _MOST_LISTED:
        yield f"and {len(result.outliers) - _MOST_LISTED} more outliers; --json lists them all"


def knot_lines(knots: Iterable[KnotChoice]) -> Iterator[str]:
    """How many knots each ``spline:auto`` got, where, and how sure that is."""
    for found in knots:
        places = ", ".join(
            f"{in_digits(q, 4)} ± {in_digits(s, 2)}"
            for q, s in zip(found.knots, found.spread, strict=True)
        )
        chances = ", ".join(f"{k}: {p:.0%}" for k, p in found.probability.items() if p >= 0.005)
        unit, factor = display(found.unit)
        where = f" at {places} {found.where}" if found.knots else ""
        yield (
            f"knots of {found.effect}: {len(found.knots)}{where} (how many, by evidence: "
            f"{chances}; other choices move the curve by "
            f"±{in_digits(found.curve_sd * factor, 2)} {unit})"
        )


def parameter_lines(result: Solution) -> Iterator[str]:
    """Effects of one or two parameters with value ± standard uncertainty; shapes by their count."""
    for i, term in enumerate(result.model.terms):
        if len(term.values) > 2:
            yield f"{term.effect.spec}: {len(term.values)} coefficients"
            continue
        parts = []
        layout = result.problem.layout
        unknowns = layout.unknowns[layout.terms[i]]
        for (name, value), unknown in zip(term.values.items(), unknowns, strict=True):
            shown, factor = read_in(unknown)
            sd = 0.0 if value.sd is None else value.sd
            if not value.measured:
                parts.append(f"{name} not measured")
                continue
            if sd < _NOTHING * unknown.scale:
                parts.append(
                    f"{name} = {in_digits(value.value * factor, 4)} {shown}, by convention"
                )
                continue
            text = f"{name} = {with_uncertainty(value.value * factor, sd * factor)} {shown}"
            if name in reversed_parameters(result.model.machine, term.effect):
                there = in_digits(-value.value * factor, 4, sign=True)
                text += f" (on the table itself {there} {shown})"
            parts.append(text)
        yield f"{term.effect.spec}: {', '.join(parts)}"


def rotary_words(result: Solution) -> Iterator[str]:
    """Lines about rotary axes' average lines, and about signs when measured on a table."""
    yield from average_line_words(result.model)
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
