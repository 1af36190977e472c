"""The answer of ``abbe compare``: as JSON (formats.md); lengths µm, angles µrad."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.sampling import samplings
from abbe.compcore.comparison.compare import Comparison
from abbe.compcore.comparison.parts import ComparedRows
from abbe.compcore.diagnosis.changed import standing
from abbe.compcore.diagnosis.explain import changed
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model
from abbe.daemon.answers.model.fit import finite, starts_json
from abbe.daemon.answers.outside import outside_json


def as_json(comparison: Comparison) -> dict[str, Any]:
    """One object for ``--json``; tables of lengths at the top, those of rotations apart."""
    noise = comparison.noise
    lengths = noise.lengths
    rotation = noise.levels.get("rotation")
    return {
        **_part(comparison, comparison.lengths, "um", 1e3),
        "noise_floor": None if lengths is None or lengths.value is None else lengths.value * 1e3,
        "noise": {kind: str(level) for kind, level in noise.levels.items()},
        "lines": [
            {
                "setup": line.setup,
                "n": line.n,
                "length": line.length,
                "linear_before": None if line.linear_before is None else line.linear_before * 1e3,
                "linear_after": None if line.linear_after is None else line.linear_after * 1e3,
                "rest_before": line.rest_before * 1e3,
                "rest_after": line.rest_after * 1e3,
            }
            for line in comparison.lines
        ],
        "uncertainty": {k.name.lower(): s for k, s in comparison.uncertainty.source.items()},
        "sampling": [
            {
                "axis": s.axis,
                "setup": s.setup,
                "even": s.even,
                "unit": "deg" if is_rotary(s.axis) else "mm",
                "step": math.degrees(s.step) if is_rotary(s.axis) else s.step,
                "shortest_wave": math.degrees(s.shortest) if is_rotary(s.axis) else s.shortest,
            }
            for s in samplings(comparison.problem.campaign)
        ],
        "run_starts": starts_json(comparison.problem, comparison.theta),
        "extrapolated": _extrapolated(comparison),
        "left_out": [*comparison.left_out, *comparison.other_day],
        "suspicions": list(comparison.suspicions),
        "rotation": {
            **_part(comparison, comparison.rotations, "urad", 1e6),
            "noise_floor": (
                None if rotation is None or rotation.value is None else rotation.value * 1e6
            ),
        },
    }


def with_changes(model: Model, campaign: Campaign, comparison: Comparison) -> Comparison:
    """The comparison with what has changed since the model was fitted, where it does not hold."""
    if comparison.holds or not model.terms or any(not t.fitted for t in model.terms):
        return comparison
    found = standing(model, fit(model, campaign).thin)
    return replace(comparison, changed=() if found is None else tuple(changed(found)))


def _extrapolated(comparison: Comparison) -> dict[str, Any] | None:
    """Signals that were not measured so, on what share of the rows, what is left there and else."""
    out, beyond = comparison.extrapolated
    if not beyond:
        return None
    found: dict[str, Any] = {"share": float(out.mean()), "beyond": outside_json(beyond)}
    for name, part, factor in (
        ("lengths", comparison.lengths, 1e3),
        ("rotations", comparison.rotations, 1e6),
    ):
        inside, outside = comparison.inside_and_out(part)
        found[name] = {"rms": finite(outside, factor), "rms_elsewhere": finite(inside, factor)}
    return found


def _part(comparison: Comparison, part: ComparedRows, unit: str, factor: float) -> dict[str, Any]:
    campaign = comparison.problem.campaign
    positions = campaign.conditions.positions
    return {
        "n": part.n,
        "unit": unit,
        "rms": finite(part.rms, factor),
        "max": finite(part.max, factor),
        "p95": finite(part.p95, factor),
        "chi2_per_dof": finite(part.chi2_per_dof),
        **part.tables.as_dict(),
        "worst": [
            {
                "row": point.row,
                "file": campaign.file_of(point.row),
                "line": point.line,
                "setup": point.setup,
                "residual": point.residual * factor,
                "sd": point.sd * factor,
                "at": {axis: float(values[point.row]) for axis, values in positions.items()},
            }
            for point in part.worst
        ],
    }
