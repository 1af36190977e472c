"""The record of a fit in a model's file: the ``[fit]`` section and the history."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from abbe.compcore.campaign.campaign import LENGTHS, Kind
from abbe.compcore.campaign.noise import NoiseFloor
from abbe.compcore.errors import require_type
from abbe.compcore.files.model_file import summary
from abbe.compcore.files.model_toml.campaign_record import campaign_records, noise_by_file
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model


def measured_ranges(conditions: Conditions) -> dict[str, Any]:
    """Where signals (each in its unit), axes (mm, degrees) and the tool's offset (mm) ranged.

    A live correction is no better founded elsewhere, and a sensor that shows something far from
    it is more likely to be broken.
    """
    found: dict[str, Any] = {}
    for name, values in conditions.signals.items():
        known = values[np.isfinite(values)]
        if known.size:
            found[name] = [float(known.min()), float(known.max())]
    tool = conditions.tool
    stood = {
        a: [float(e) for e in np.round(np.degrees(ends) if is_rotary(a) else ends, 9)]
        for a, q in conditions.positions.items()
        if len(q) and np.isfinite(ends := np.array([q.min(), q.max()])).all()
    }
    return {
        "signals": found,
        "positions": stood,
        "tool": [[float(column.min()), float(column.max())] for column in tool.T],
    }


def measured_differences(model: Model, conditions: Conditions) -> dict[str, Any]:
    """How far the temperatures that a model reads were apart: one → other → least, greatest, K.

    Each may be where it was, and all of them together as they never were.
    """
    temperatures = [
        name
        for name, signal in model.machine.signals.items()
        if signal.temperature and name in model.signals_needed() and name in conditions.signals
    ]
    found: dict[str, Any] = {}
    for one, other in combinations(temperatures, 2):
        apart = conditions.signals[one] - conditions.signals[other]
        known = apart[np.isfinite(apart)]
        if known.size:
            ends = [round(float(known.min()), 3), round(float(known.max()), 3)]
            found.setdefault(one, {})[other] = ends
    return found


def recorded(
    result: FitResult,
    ancestor: Model,
    *,
    date: str,
    version: str,
    noise_floor: float | None,
    noise_floor_rotation: float | None = None,
    noise: Sequence[NoiseFloor] | None = None,
) -> Model:
    """The fitted model with its provenance, and its ancestor's one-line record in the history.

    Parameters
    ----------
    result
        What the fit found.
    ancestor
        The model that was fitted; when it had been fitted before, its record joins the history.
    date, version
        When (ISO 8601) and with which version of Abbe.
    noise_floor, noise_floor_rotation
        mm and rad; None where the campaign cannot tell.
    noise
        Of each of the campaign's files, where it is known already (`noise_by_file`).
    """
    require_type(result, FitResult, "result")
    require_type(ancestor, Model, "ancestor")
    campaign = result.problem.campaign
    if noise is None:
        noise = noise_by_file(campaign, result.model.machine, result.noise)
    before = {} if result.renewal is None else result.renewal.before.fit
    now = set(campaign.files.values())
    earlier = [c for c in before.get("campaigns", ()) if c.get("sha256") not in now]
    record: dict[str, Any] = {
        "date": date,
        "campaigns": [*earlier, *campaign_records(campaign, result.residual, noise)],
        "n": campaign.n,
        "unit": "um",
        "rms": result.rms(*LENGTHS) * 1e3,
        "noise_floor": None if noise_floor is None else noise_floor * 1e3,
        "rms_rotation_urad": result.rms(Kind.ROTATION) * 1e6,
        "noise_floor_rotation_urad": (
            None if noise_floor_rotation is None else noise_floor_rotation * 1e6
        ),
        "chi2_per_dof": result.chi2_per_dof,
        "dof": result.dof,
        "determined": result.determined,
        "cautious": True if result.caution is not None else None,
        "renewed": None
        if result.renewal is None
        else {
            "fitted_anew": [e.spec for e in result.renewal.let_go],
            "by": sorted(campaign.files.values()),
            "variance": result.renewal.variance,
        },
        "abbe": version,
        "measured": wider(
            {
                **measured_ranges(campaign.conditions),
                "differences": measured_differences(result.model, campaign.conditions),
            },
            before,
        ),
        "knots": [
            {
                "effect": k.effect,
                "unit": k.where,
                "places": list(k.knots),
                "sd": [round(s, 6) for s in k.spread],
                "probability": {str(n): round(p, 6) for n, p in k.probability.items()},
            }
            for k in result.knots
        ]
        or None,
    }
    kept = {
        k: v
        for k, v in record.items()
        if v is not None and not (isinstance(v, float) and math.isnan(v))
    }
    history = ancestor.history
    if ancestor.fit:
        history = (*history, summary(ancestor))
    return replace(result.model, fit=kept, history=history)


def wider(measured: dict[str, Any], before: Mapping[str, Any]) -> dict[str, Any]:
    """Ranges that hold those of the campaigns before, too."""
    known = before.get("measured", {})
    both = dict(measured)
    for kind in ("signals", "positions"):
        ranges = dict(known.get(kind, {}))
        for name, ends in measured[kind].items():
            ranges[name] = _hull(ends, ranges.get(name, ends))
        both[kind] = ranges
    both["differences"] = _wider_apart(measured["differences"], known)
    tool = known.get("tool", measured["tool"])
    both["tool"] = [_hull(one, other) for one, other in zip(measured["tool"], tool, strict=True)]
    return both


def _wider_apart(
    now: Mapping[str, Mapping[str, Sequence[float]]], known: Mapping[str, Any]
) -> dict[str, dict[str, Sequence[float]]]:
    """How far temperatures were apart, now and before; not of those of which nobody recorded it."""
    both = {one: dict(others) for one, others in known.get("differences", {}).items()}
    recorded_before = set(known.get("signals", {}))
    for one, others in now.items():
        before = both.setdefault(one, {})
        for other, ends in others.items():
            if other in before or not recorded_before >= {one, other}:
                before[other] = _hull(ends, before.get(other, ends))
    return {one: others for one, others in both.items() if others}


def _hull(one: Sequence[float], other: Sequence[float]) -> list[float]:
    return [min(one[0], other[0]), max(one[1], other[1])]
