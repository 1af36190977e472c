"""Pictures of residuals: in the volume, along axes, against signals, over time, against chance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.comparison.lines import MeasuredLine, functional_moves
from abbe.compcore.machine.machine import own_component
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.error_map import ErrorMap
from abbe.compcore.model.motion_curves import MotionCurve
from abbe.daemon.report.figure import COLOURS, band, figure, line, points

F64 = NDArray[np.float64]
Index = NDArray[np.int64]
Figure = dict[str, Any]

MOST_POINTS = 6000
"""More rows than this are drawn as a sample, with all of the largest residuals."""
_LARGEST = 500
_REACH = 0.12
"""The longest vector's length in the picture, as a part of the volume's diagonal."""
_GREY = "#9aa4ae"


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of one kind of rows, ready to be drawn.

    Attributes
    ----------
    campaign
        Where the rows come from.
    rows
        Indices of the rows that are drawn.
    value
        Residual of each row drawn, in `unit`.
    size
        Residuals in units of their standard uncertainty.
    unit
        µm or µrad.
    sampled
        Whether only a part of the rows is drawn.
    """

    campaign: Campaign
    rows: Index
    value: F64
    size: F64
    unit: str
    sampled: bool

    @classmethod
    def of(
        cls, campaign: Campaign, rows: NDArray[np.bool_], residual: F64, weighted: F64, unit: str
    ) -> Residuals:
        """Residuals (n,), mm or rad, of some rows; `weighted` in units of sd."""
        index = np.flatnonzero(rows)
        sampled = len(index) > MOST_POINTS
        if sampled:
            order = index[np.argsort(-np.abs(residual[index]), kind="stable")]
            others = np.random.default_rng(0).choice(
                order[_LARGEST:], MOST_POINTS - _LARGEST, replace=False
            )
            index = np.sort(np.concatenate([order[:_LARGEST], others]))
        factor = 1e6 if unit == "µrad" else 1e3
        return cls(campaign, index, residual[index] * factor, weighted[index], unit, sampled)

    @property
    def labels(self) -> list[str]:
        """What the pointer shows of each row."""
        setup = self.campaign.conditions.setup
        lines_ = self.campaign.line[self.rows]
        if setup is None:
            return [f"line {k}" for k in lines_]
        return [f"{s}, line {k}" for s, k in zip(setup[self.rows], lines_, strict=True)]


def in_volume(residuals: Residuals) -> Figure:
    """Residuals as vectors along the measured direction, in the machine's volume; can be turned."""
    u = residuals.campaign.conditions.u
    start = functional_moves(residuals.campaign)[residuals.rows]
    along = np.zeros_like(start) if u is None else u[residuals.rows]
    diagonal = float(np.linalg.norm(np.ptp(start, axis=0))) if len(start) else 1.0
    largest = float(np.abs(residuals.value).max(initial=0.0)) or 1.0
    enlarged = _REACH * max(diagonal, 1.0) / largest
    end = start + along * (residuals.value * enlarged)[:, None]
    gaps = np.full_like(start, np.nan)
    path = np.stack([start, end, gaps], axis=1).reshape(-1, 3)
    colour = np.repeat(np.abs(residuals.value), 3)
    shared: dict[str, Any] = {"type": "scatter3d", "showlegend": False}
    vectors = {
        **shared,
        "mode": "lines",
        "x": path[:, 0],
        "y": path[:, 1],
        "z": path[:, 2],
        "line": {
            "width": 4,
            "color": colour,
            "colorscale": "Viridis",
            "showscale": True,
            "colorbar": {"title": {"text": residuals.unit}, "thickness": 14},
        },
        "hoverinfo": "skip",
    }
    tips = {
        **shared,
        "mode": "markers",
        "x": end[:, 0],
        "y": end[:, 1],
        "z": end[:, 2],
        "marker": {"size": 2, "color": np.abs(residuals.value), "colorscale": "Viridis"},
        "text": [
            f"{label}: {value:+.2f} {residuals.unit}"
            for label, value in zip(residuals.labels, residuals.value, strict=True)
        ],
        "hoverinfo": "text",
    }
    scene = {f"{k}axis": {"title": {"text": f"{k.upper()} (mm)"}} for k in "xyz"}
    return figure([vectors, tips], height=620, scene={**scene, "aspectmode": "data"})


def along_axis(residuals: Residuals, axis: str) -> Figure:
    """Residuals against an axis's position, coloured by the direction of approach."""
    c = residuals.campaign.conditions
    factor, unit = (180.0 / np.pi, "°") if is_rotary(axis) else (1.0, "mm")
    position = c.position(axis)[residuals.rows] * factor
    direction = c.direction(axis)[residuals.rows]
    traces = [
        _dots(residuals, position, direction == sign, name, colour)
        for sign, name, colour in (
            (1.0, f"{axis} approached upwards", COLOURS[0]),
            (-1.0, f"{axis} approached downwards", COLOURS[1]),
            (0.0, "not moved or unknown", _GREY),
        )
        if (direction == sign).any()
    ]
    return _scatter(traces, f"{axis} ({unit})", residuals.unit)


def against(residuals: Residuals, values: F64, title: str) -> Figure:
    """Residuals against a signal or time; `values` shape (n,) of all the campaign's rows."""
    chosen = values[residuals.rows]
    every = np.ones(len(chosen), dtype=np.bool_)
    traces = [_dots(residuals, chosen, every, "residuals", COLOURS[0])]
    running = _running_mean(chosen, residuals.value)
    if running is not None:
        traces.append(line(*running, "mean", line={"color": COLOURS[1], "width": 2.5}))
    return _scatter(traces, title, residuals.unit)


def quantiles(residuals: Residuals) -> Figure:
    """Sorted residuals in units of their uncertainty against those of a normal distribution."""
    size = np.sort(residuals.size)
    n = len(size)
    chance = ndtri((np.arange(n) + 0.5) / max(n, 1))
    ends = np.array([chance[0], chance[-1]]) if n else np.zeros(2)
    traces = [
        points(chance, size, "residuals", marker={"size": 4, "color": COLOURS[0]}),
        line(ends, ends, "as they should be", line={"color": _GREY, "dash": "dash"}),
    ]
    return figure(traces, "normal distribution (standard deviations)", "residual / its uncertainty")


def line_parts(lines: list[MeasuredLine]) -> Figure:
    """Each line's linear part and rest, before and after the model."""
    names = [f"{entry.setup}" for entry in lines]
    bars = []
    for values, name, colour in (
        ([entry.linear_before for entry in lines], "linear, before", "#a9cfe8"),
        ([entry.linear_after for entry in lines], "linear, after", COLOURS[0]),
        ([entry.rest_before for entry in lines], "rest, before", "#f3c9a5"),
        ([entry.rest_after for entry in lines], "rest, after", COLOURS[1]),
    ):
        height = [None if v is None else abs(v) * 1e3 for v in values]
        bars.append(
            {"type": "bar", "x": names, "y": height, "name": name, "marker": {"color": colour}}
        )
    return figure(bars, "", "µm from end to end; peak to valley", barmode="group")


def motions(curves: list[MotionCurve], axis: str) -> Figure:
    """Error motions of one axis and kind (all lengths or all angles) with their 95 % bands."""
    factor, unit = (180.0 / np.pi, "°") if is_rotary(axis) else (1.0, "mm")
    rotation = curves[0].error_motion.rotation
    scale = 1e6 if rotation else 1e3
    traces: list[dict[str, Any]] = []
    for curve, colour in zip(curves, COLOURS, strict=False):
        x, y, half = curve.position * factor, curve.value * scale, 1.96 * curve.sd * scale
        traces += band(x, y - half, y + half, colour)
        traces.append(line(x, y, str(curve.error_motion), line={"color": colour, "width": 2}))
    return figure(traces, f"{axis} ({unit})", "µrad" if rotation else "µm", height=340)


def plane(found: ErrorMap) -> Figure:
    """An error map as a grid that the errors distort, and its worst pair of points."""
    x, y = np.meshgrid(*found.grid, indexing="ij")
    k = ["XYZ".index(own_component(a)) for a in found.across]
    within = found.error[:, :, k]
    largest = float(np.abs(within).max()) or 1.0
    reach = _REACH * float(max(np.ptp(x), np.ptp(y)))
    moved_x, moved_y = (c + within[:, :, i] * reach / largest for i, c in enumerate((x, y)))
    traces = []
    for nodes_x, nodes_y, name, colour in (
        (x, y, "as indicated", _GREY),
        (moved_x, moved_y, f"as it is, errors × {reach / largest:.0f}", COLOURS[0]),
    ):
        gap = np.full((1, nodes_x.shape[0]), np.nan)
        along = [np.vstack([nodes.T, gap]).T.ravel() for nodes in (nodes_x, nodes_y)]
        other = [np.vstack([nodes, gap]).T.ravel() for nodes in (nodes_x, nodes_y)]
        path_x, path_y = (np.concatenate([a, b]) for a, b in zip(along, other, strict=True))
        traces.append(line(path_x, path_y, name, line={"color": colour, "width": 1}))
    ends = [np.array(found.worst[a]) for a in found.across]
    marker = {"size": 9, "color": COLOURS[1]}
    words = f"worst pair: {found.worst_error * 1e3:+.1f} µm"
    traces.append(points(ends[0], ends[1], words, marker=marker))
    first, second = found.across
    equal = {"scaleanchor": "x"}
    return figure(traces, f"{first} (mm)", f"{second} (mm)", height=620, yaxis=equal)


def _dots(
    residuals: Residuals, x: F64, chosen: NDArray[np.bool_], name: str, colour: str
) -> dict[str, Any]:
    labels = residuals.labels
    return points(
        x[chosen],
        residuals.value[chosen],
        name,
        text=[labels[i] for i in np.flatnonzero(chosen)],
        marker={"size": 4, "opacity": 0.6, "color": colour},
    )


def _scatter(traces: list[dict[str, Any]], x: str, unit: str) -> Figure:
    return figure(traces, x, f"residual ({unit})", height=360)


def _running_mean(x: F64, y: F64, parts: int = 20) -> tuple[F64, F64] | None:
    if len(x) < 4 * parts or np.ptp(x) == 0.0:
        return None
    order = np.array_split(np.argsort(x, kind="stable"), parts)
    return np.array([x[i].mean() for i in order]), np.array([y[i].mean() for i in order])
