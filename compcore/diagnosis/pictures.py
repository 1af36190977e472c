"""Pictures of a diagnosis: where residuals stand, what each cause explains, all candidates."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.diagnosis.findings import Established, Findings
from abbe.compcore.diagnosis.uncatalogued.residual_pattern import ResidualPattern
from abbe.compcore.figures.figure import (
    COLOURS,
    SIGNED,
    Figure,
    Trace,
    figure,
    line,
    points,
    space,
)
from abbe.compcore.figures.residuals import fills_a_volume

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

IN_VOLUME = "residuals in the volume"
ON_LINE = "residuals on the line"
"""Where all places lie on one, in place of the volume."""
OVER_TIME = "residuals over time"
CANDIDATES = "candidates"
_BARS = 12


def diagnosis_figures(findings: Findings) -> dict[str, Callable[[], Figure]]:
    """Every picture by name, made when called; ``cause 1`` is the first that is established."""
    made: dict[str, Callable[[], Figure]] = {}
    campaign = findings.result.problem.campaign
    rows = np.flatnonzero(campaign.kind == Kind.DISPLACEMENT)
    u = campaign.conditions.u
    if rows.size and u is not None:
        places = _places(findings, rows)
        if fills_a_volume(places):
            made[IN_VOLUME] = partial(_in_volume, findings, rows, u[rows])
        elif np.ptp(places, axis=0).any():
            made[ON_LINE] = partial(_on_line, findings, rows)
        if campaign.clocked:
            made[OVER_TIME] = partial(_over_time, findings, rows, u[rows])
    for i, established in enumerate(findings.established, start=1):
        made[f"cause {i}"] = partial(_cause, findings, established)
    for i, structure in enumerate(findings.structure, start=1):
        made[f"structure {i}"] = partial(_structure, findings, structure)
    if any(np.isfinite(f.evidence.value) for f in findings.ranked):
        made[CANDIDATES] = partial(_candidates, findings)
    return made


def _places(findings: Findings, rows: Index) -> F64:
    """Where the functional point stood, (n, 3), mm: of an arm its joints turn it there."""
    result = findings.result
    return result.problem.observation(result.theta).chain.point[rows]


def _in_volume(findings: Findings, rows: Index, u: F64) -> Figure:
    return _vectors(_places(findings, rows), u, findings.result.residual[rows] * 1e3)


def _on_line(findings: Findings, rows: Index) -> Figure:
    place = _places(findings, rows)
    k = int(np.argmax(np.ptp(place, axis=0)))
    marker = {"size": 4, "color": COLOURS[0]}
    traces = [points(place[:, k], findings.result.residual[rows] * 1e3, "residuals", marker=marker)]
    return figure(traces, f"{'XYZ'[k]} in mm", "residual in µm", height=320)


def _over_time(findings: Findings, rows: Index, u: F64) -> Figure:
    residual = findings.result.residual[rows] * 1e3
    traces: list[Trace] = []
    hours = findings.result.problem.campaign.conditions.time[rows] / 3600.0
    for k, letter in enumerate("XYZ"):
        mine = np.abs(u[:, k]) > 0.9
        if mine.any():
            traces.append(
                points(
                    hours[mine],
                    residual[mine],
                    f"along {letter}",
                    marker={"size": 4, "color": COLOURS[k]},
                )
            )
    mixed = np.abs(u).max(axis=1) <= 0.9
    if mixed.any():
        traces.append(
            points(hours[mixed], residual[mixed], "diagonals", marker={"size": 4, "color": "#777"})
        )
    return figure(traces, "time in h", "residual in µm", height=320)


def _vectors(point: F64, u: F64, residual: F64) -> Figure:
    size = float(np.ptp(point, axis=0).max()) or 1.0
    largest = float(np.abs(residual).max()) or 1.0
    ends = point + u * residual[:, None] / largest * 0.08 * size
    gaps = np.full((len(point), 3), np.nan)
    segments = np.stack([point, ends, gaps], axis=1).reshape(-1, 3)
    colour = np.repeat(residual, 3)
    trace: Trace = {
        "type": "scatter3d",
        "mode": "lines",
        "x": segments[:, 0],
        "y": segments[:, 1],
        "z": segments[:, 2],
        "line": {
            "width": 4,
            "color": colour,
            "colorscale": SIGNED,
            "cmin": -largest,
            "cmax": largest,
            "showscale": True,
            "colorbar": {"title": {"text": "µm"}, "thickness": 14},
        },
        "hoverinfo": "skip",
    }
    scene = space(segments, [f"{k} in mm" for k in "XYZ"])
    out = figure([trace], height=520, scene=scene)
    out["layout"].pop("xaxis")
    out["layout"].pop("yaxis")
    return out


def _cause(findings: Findings, established: Established) -> Figure:
    """A cause beside the others, which are fitted first."""
    return _signature(
        findings, established.signature, established.beside_others, "what the cause would add"
    )


def _structure(findings: Findings, structure: ResidualPattern) -> Figure:
    described = _described(findings, structure)
    return _signature(findings, described, findings.result.residual, "what is described")


def _signature(findings: Findings, signature: F64, residual: F64, what: str) -> Figure:
    """Residual against a signature, both (n,), mm or rad: on the diagonal what it explains."""
    campaign = findings.result.problem.campaign
    used = findings.result.problem.weight > 0.0
    rows = (campaign.kind == Kind.DISPLACEMENT) & used
    factor, unit = 1e3, "µm"
    if not rows.any():
        rows, factor, unit = (campaign.kind == Kind.ROTATION) & used, 1e6, "µrad"
    x = signature[rows] * factor
    y = residual[rows] * factor
    order = np.argsort(x)
    count = max(1, min(24, len(x) // 25))
    bins = np.array_split(order, count)
    middle = np.array([x[b].mean() for b in bins])
    mean = np.array([y[b].mean() for b in bins])
    ends = np.array([x.min(), x.max()])
    return figure(
        [
            points(x, y, "rows", marker={"size": 3, "color": "#9aa4ae"}),
            line(ends, ends, "explained fully", line={"color": COLOURS[0], "dash": "dash"}),
            points(middle, mean, "mean of residuals", marker={"size": 9, "color": COLOURS[1]}),
        ],
        f"{what}, {unit}",
        f"residual without it, {unit}",
        height=380,
    )


def _described(findings: Findings, structure: ResidualPattern) -> F64:
    """What a description says of each row, beyond what the model can imitate, (n,), mm or rad."""
    basis = findings.basis
    columns = basis.project(structure.columns)
    fitted = columns @ np.linalg.lstsq(columns, basis.residual, rcond=1e-10)[0]
    return np.asarray(fitted / findings.result.problem.weight)


def _candidates(findings: Findings) -> Figure:
    leading = [f for f in findings.ranked if np.isfinite(f.evidence.value)][:_BARS]
    names = [f.candidate.effect.spec for f in leading][::-1]
    values = [f.evidence.value for f in leading][::-1]
    bar: Trace = {
        "type": "bar",
        "orientation": "h",
        "x": values,
        "y": names,
        "marker": {"color": [COLOURS[0] if v > 12.0 else "#c3cad1" for v in values]},
    }
    return figure([bar], "evidence", height=60 + 26 * len(leading), yaxis={"automargin": True})
