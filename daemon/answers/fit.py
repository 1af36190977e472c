"""The answer of ``abbe fit``: as JSON and as text; lengths in µm, angles in µrad."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.campaign.noise import NoiseFloor, NoiseLevel
from abbe.compcore.comparison.compare import LENGTHS
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.fitting.rigid_body import rigid_body_test
from abbe.compcore.units import display
from abbe.daemon.answers import as_built
from abbe.daemon.answers.inputs import file_of

_MOST_TOLD = 20
_NOTHING = 1e-9
"""A standard uncertainty below this part of what is believable belongs to a convention."""
FLEXES = 0.01
"""Corrected p-value below which a machine counts as not rigid."""
_SOURCES = {
    "stated": "as stated in the campaign",
    "replicates": "from repeated measurements, as the campaign states none",
    "residuals": "from what the fit leaves over, as the campaign states none: χ²/dof tells nothing",
}


def floor_of_lengths(noise: NoiseFloor) -> NoiseLevel | None:
    """The noise of displacements, or of distances where there are none."""
    return noise.levels.get("displacement") or noise.levels.get("distance")


def finite(value: float, factor: float = 1.0) -> float | None:
    """A number for JSON, which has no NaN."""
    return value * factor if math.isfinite(value) else None


def as_json(result: FitResult, noise: NoiseFloor) -> dict[str, Any]:
    """One object for ``--json``."""
    campaign = result.problem.campaign
    lengths = floor_of_lengths(noise)
    rotation = noise.value("rotation")
    floor = None if lengths is None else lengths.value
    return {
        "n": campaign.n,
        "unit": "um",
        "rms": finite(result.rms(*LENGTHS), 1e3),
        "noise_floor": None if floor is None else floor * 1e3,
        "chi2_per_dof": finite(result.chi2_per_dof),
        "dof": result.dof,
        "parameters": len(result.problem.layout.unknowns),
        "determined": result.decomposition.rank,
        "nuisances": result.eliminator.rank,
        "rotation": {
            "unit": "urad",
            "rms": finite(result.rms(Kind.ROTATION), 1e6),
            "noise_floor": None if rotation is None else rotation * 1e6,
        },
        "uncertainty": {k.name.lower(): s for k, s in result.uncertainty.source.items()},
        "effects": [
            {
                "spec": term.effect.spec,
                "scope": term.effect.scope,
                "parameters": {
                    name: {"value": v.value, "sd": v.sd, "unit": unit}
                    for (name, v), unit in zip(term.values.items(), _units(result, i), strict=True)
                },
                "on_the_table": as_built.seen_json(result.model.machine, term.effect, term.values),
            }
            for i, term in enumerate(result.model.terms)
        ],
        "rotary_axes": as_built.lines_json(result.model),
        "bases": _places(result),
        "undetermined": [
            {"text": u.text, "effects": list(u.effects), "convention": u.convention}
            for u in result.undetermined
        ],
        "rigid_body": [
            {
                "motion": t.motion,
                "by": t.by,
                "p_value": t.adjusted,
                "rms": t.rms * 1e3,
                "alike": list(t.alike),
            }
            for t in rigid_body_test(result)[:_MOST_TOLD]
        ],
        "outliers": [
            {
                "row": o.row,
                "file": file_of(campaign, o.row),
                "line": o.line,
                "setup": o.setup,
                "residual": o.residual * _factor(result, o.row),
                "size": o.size,
                "set_aside": bool(result.set_aside),
            }
            for o in result.outliers
        ],
    }


def as_text(result: FitResult, noise: NoiseFloor) -> Iterator[str]:
    """Lines for people."""
    problem = result.problem
    layout = problem.layout
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
            yield f"residuals of {name}: {rms * factor:.3g} {unit} rms"
    yield f"χ² per degree of freedom: {result.chi2_per_dof:.3f} ({result.dof})"
    for kind, source in result.uncertainty.source.items():
        yield f"uncertainty of each {kind.name.lower().replace('_', ' ')}: {_SOURCES[source]}"
    yield str(noise)
    for found in result.undetermined:
        yield ("convention: " if found.convention else "NOT DETERMINED: ") + found.text
    for test in rigid_body_test(result):
        if test.adjusted < FLEXES:
            alike = "".join(f", or {other}" for other in test.alike)
            yield (
                f"NOT RIGID: {test.motion} depends on {test.by}{alike} "
                f"(p = {test.adjusted:.1g}, {test.rms * 1e3:.2g} µm rms)"
            )
            break
    if result.outliers and result.misfit and not result.set_aside:
        yield (
            f"{len(result.outliers)} rows stand out, but χ² says that the model lacks something "
            "rather than that rows are wrong: see `abbe diagnose`"
        )
        return
    reported = "set aside" if result.set_aside else "used; --robust would set it aside"
    for outlier in result.outliers[:_MOST_TOLD]:
        value = outlier.residual * _factor(result, outlier.row)
        unit = "µrad" if problem.campaign.kind[outlier.row] == Kind.ROTATION else "µm"
        yield (
            f"outlier: {file_of(problem.campaign, outlier.row)}, line {outlier.line}, "
            f"set-up {outlier.setup}: {value:+.3g} {unit}, "
            f"{outlier.size:.1f} standard deviations ({reported})"
        )
    if len(result.outliers) > _MOST_TOLD:
        yield f"and {len(result.outliers) - _MOST_TOLD} more outliers; --json lists them all"


def parameter_lines(result: FitResult) -> Iterator[str]:
    """Effects of one or two parameters with value ± standard uncertainty; shapes by their count."""
    for i, term in enumerate(result.model.terms):
        if len(term.values) > 2:
            yield f"{term.effect.spec}: {len(term.values)} coefficients"
            continue
        parts = []
        layout = result.problem.layout
        unknowns = layout.unknowns[layout.terms[i]]
        for (name, value), unknown in zip(term.values.items(), unknowns, strict=True):
            shown, factor = display(unknown.unit)
            sd = 0.0 if value.sd is None else value.sd
            if sd < _NOTHING * unknown.scale:
                parts.append(f"{name} = {value.value * factor:.4g} {shown}, by convention")
                continue
            text = f"{name} = {value.value * factor:.4g} ± {sd * factor:.2g} {shown}"
            if name in as_built.reversed_names(result.model.machine, term.effect):
                text += f" (on the table itself {-value.value * factor:+.4g} {shown})"
            parts.append(text)
        yield f"{term.effect.spec}: {', '.join(parts)}"
    yield from as_built.lines_text(result.model)
    if any(as_built.reversed_names(result.model.machine, e) for e in result.model.effects):
        yield as_built.ON_THE_TABLE


def _units(result: FitResult, term: int) -> list[str]:
    layout = result.problem.layout
    return [u.unit for u in layout.unknowns[layout.terms[term]]]


def _places(result: FitResult) -> dict[str, list[float]]:
    return {
        name: [float(v) for v in result.theta[where]]
        for name, where in result.problem.layout.bases.items()
    }


def _factor(result: FitResult, row: int) -> float:
    return 1e6 if result.problem.campaign.kind[row] == Kind.ROTATION else 1e3
