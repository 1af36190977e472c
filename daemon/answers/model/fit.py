"""The answer of ``abbe fit``: as JSON; lengths in µm, angles in µrad."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import LENGTHS, Kind
from abbe.compcore.campaign.noise import NoiseFloor
from abbe.compcore.fitting.design.begun import begun
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.fitting.rigid_body import rigid_body_test
from abbe.compcore.model.held_spindle import held_spindle, tool_of
from abbe.compcore.units import display
from abbe.daemon.answers import as_built

_MOST_LISTED = 20


def finite(value: float, factor: float = 1.0) -> float | None:
    """A number for JSON, which has no NaN."""
    return value * factor if math.isfinite(value) else None


def as_json(result: FitResult, noise: NoiseFloor) -> dict[str, Any]:
    """One object for ``--json``."""
    campaign = result.problem.campaign
    lengths = noise.lengths
    rotation = noise.value("rotation")
    floor = None if lengths is None else lengths.value
    return {
        "n": campaign.n,
        "unit": "um",
        "rms": finite(result.rms(*LENGTHS), 1e3),
        "noise_floor": None if floor is None else floor * 1e3,
        "chi2_per_dof": finite(result.chi2_per_dof),
        "dof": result.dof,
        "suspicions": list(result.suspicions),
        "parameters": len(result.problem.layout.unknowns),
        "determined": result.decomposition.rank,
        "frame": {
            "primary": result.frame.primary or None,
            "secondary": result.frame.secondary or None,
            "tool_mm": None if result.frame.tool is None else list(result.frame.tool),
        },
        "nuisances": result.eliminator.rank,
        "gauges": dict(result.gauges),
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
                    name: {"value": v.value, "sd": v.sd, "unit": unit, "measured": v.measured}
                    for (name, v), unit in zip(term.values.items(), _units(result, i), strict=True)
                },
                "on_the_table": as_built.seen_json(result.model.machine, term.effect, term.values),
            }
            for i, term in enumerate(result.model.terms)
        ],
        "knots": [
            {
                "effect": k.effect,
                "unit": k.where,
                "places": list(k.knots),
                "sd": list(k.spread),
                "probability": {str(n): p for n, p in k.probability.items()},
                "curve_sd": k.curve_sd * display(k.unit)[1],
                "curve_unit": display(k.unit)[0],
            }
            for k in result.knots
        ],
        "run_starts": starts_json(result.problem, result.theta),
        "rotary_axes": as_built.lines_json(result.model),
        "spindle": as_built.spindle_json(
            held_spindle(result.model, tool_of(result.problem.campaign))
        ),
        "bases": _places(result),
        "undetermined": undetermined_json(result),
        "rigid_body": [
            {
                "motion": t.motion,
                "by": t.by,
                "p_value": t.adjusted,
                "rms": t.rms * 1e3,
                "alike": list(t.alike),
            }
            for t in rigid_body_test(result)[:_MOST_LISTED]
        ],
        "outliers": [
            {
                "row": o.row,
                "file": campaign.file_of(o.row),
                "line": o.line,
                "setup": o.setup,
                "residual": o.residual * _factor(result, o.row),
                "size": o.size,
                "set_aside": bool(result.set_aside),
            }
            for o in result.outliers
        ],
    }


def undetermined_json(result: FitResult) -> list[dict[str, Any]]:
    """What a campaign does not show of a model, as ``--json`` prints it."""
    return [
        {"text": u.text, "effects": list(u.effects), "convention": u.convention}
        for u in result.undetermined
    ]


def starts_json(problem: Problem, theta: NDArray[np.float64]) -> list[dict[str, Any]]:
    """How far lagged bodies were from their signals when each run began."""
    return [
        {
            "file": found.file,
            "effect": found.spec,
            "signal": found.signal,
            "off_equilibrium": list(found.off),
            "furthest": found.furthest,
            "unit": found.unit,
            "plausible": found.plausible,
        }
        for found in begun(problem, theta)
    ]


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
