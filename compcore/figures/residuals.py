"""Pictures of residuals: in the volume, along axes, against signals, over time, against chance."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.figures.figure import (
    COLOURS,
    GREY,
    REACH,
    SIGNED,
    Figure,
    figure,
    line,
    points,
    space,
)
from abbe.compcore.figures.means import mean_line
from abbe.compcore.figures.places import places
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

_SYMBOLS = {"X": "circle", "Y": "square", "Z": "diamond", "oblique": "x"}
MOST_POINTS = 6000
"""More rows than this are drawn as a sample, with all of the largest residuals."""
_LARGEST = 500


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
    machine
        The machine, whose joints say where a functional point stood.
    """

    campaign: Campaign
    rows: Index
    value: F64
    size: F64
    unit: str
    sampled: bool
    machine: Machine | None = None

    @classmethod
    def of(
        cls,
        campaign: Campaign,
        rows: NDArray[np.bool_],
        residual: F64,
        weighted: F64,
        unit: str,
        machine: Machine | None = None,
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
        return cls(
            campaign, index, residual[index] * factor, weighted[index], unit, sampled, machine
        )

    @property
    def places(self) -> F64:
        """Where each row drawn was measured, shape (n, 3), mm."""
        return places(self.campaign.rows(self.rows), self.machine)

    @property
    def labels(self) -> list[str]:
        """What the pointer shows of each row."""
        setup = self.campaign.conditions.setup
        lines_ = self.campaign.line[self.rows]
        if setup is None:
            return [f"line {k}" for k in lines_]
        return [f"{s}, line {k}" for s, k in zip(setup[self.rows], lines_, strict=True)]


def fills_a_volume(places: F64) -> bool:
    """Whether places, shape (n, 3), differ in more than one direction: a line is no volume."""
    return bool(np.count_nonzero(np.ptp(places, axis=0) > 0.0) > 1) if len(places) else False


def in_volume(residuals: Residuals) -> Figure:
    """Residuals as vectors along the measured direction, in the machine's volume; can be turned."""
    u = residuals.campaign.conditions.u
    start = residuals.places
    along = np.zeros_like(start) if u is None else u[residuals.rows]
    diagonal = float(np.linalg.norm(np.ptp(start, axis=0))) if len(start) else 1.0
    largest = float(np.abs(residuals.value).max(initial=0.0)) or 1.0
    enlarged = REACH * max(diagonal, 1.0) / largest
    end = start + along * (residuals.value * enlarged)[:, None]
    gaps = np.full_like(start, np.nan)
    path = np.stack([start, end, gaps], axis=1).reshape(-1, 3)
    colour = np.repeat(residuals.value, 3)
    signed = {"colorscale": SIGNED, "cmin": -largest, "cmax": largest}
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
            **signed,
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
        "marker": {"size": 2, "color": residuals.value, **signed},
        "text": [
            f"{label}: {value:+.2f} {residuals.unit}"
            for label, value in zip(residuals.labels, residuals.value, strict=True)
        ],
        "hoverinfo": "text",
    }
    scene = space(path, [f"{k} (mm)" for k in "XYZ"])
    return figure([vectors, tips], height=620, scene=scene)


def along_axis(residuals: Residuals, axis: str) -> Figure:
    """Residuals against an axis's position, coloured by the direction of approach."""
    c = residuals.campaign.conditions
    factor, unit = (180.0 / np.pi, "°") if is_rotary(axis) else (1.0, "mm")
    position = c.position(axis)[residuals.rows] * factor
    direction = c.direction(axis)[residuals.rows]
    component = residuals.campaign.measured_components()[residuals.rows]
    several = len(np.unique(component)) > 1
    traces = []
    for sign, name, colour in (
        (1.0, f"{axis} approached towards plus", COLOURS[0]),
        (-1.0, f"{axis} approached towards minus", COLOURS[1]),
        (0.0, "not moved or unknown", GREY),
    ):
        for measured, symbol in _SYMBOLS.items():
            chosen = (direction == sign) & (component == measured)
            if chosen.any():
                how = "obliquely" if measured == "oblique" else f"in {measured}"
                words = f"{name}, measured {how}" if several else name
                traces.append(_dots(residuals, position, chosen, words, colour, symbol))
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
    from scipy.special import ndtri

    size = np.sort(residuals.size)
    n = len(size)
    chance = ndtri((np.arange(n) + 0.5) / max(n, 1))
    ends = np.array([chance[0], chance[-1]]) if n else np.zeros(2)
    traces = [
        points(chance, size, "residuals", marker={"size": 4, "color": COLOURS[0]}),
        line(ends, ends, "as they should be", line={"color": GREY, "dash": "dash"}),
    ]
    return figure(traces, "normal distribution (standard deviations)", "residual / its uncertainty")


def residual_figures(
    residuals: Residuals, what: str, signals: Collection[str]
) -> dict[str, Callable[[], Figure]]:
    """All pictures of residuals by name, made when they are asked for.

    Parameters
    ----------
    residuals
        What is drawn.
    what
        The first word of each name: ``residuals``, ``rotations``.
    signals
        Names of the signals that are worth a picture.
    """
    c, rows = residuals.campaign.conditions, residuals.rows
    made: dict[str, Callable[[], Figure]] = {}
    if fills_a_volume(residuals.places):
        made["in the volume"] = partial(in_volume, residuals)
    for axis, position in c.positions.items():
        if position[rows].std() > 0.0:
            made[f"along {axis}"] = partial(along_axis, residuals, axis)
    for name, values in c.signals.items():
        if name in signals and values[rows].std() > 0.0:
            made[f"against {name}"] = partial(against, residuals, values, name)
    if c.time[rows].std() > 0.0:
        made["over time"] = partial(against, residuals, c.time / 3600.0, "time (h)")
    made["beside chance"] = partial(quantiles, residuals)
    return {f"{what} {name}": make for name, make in made.items()}


def _dots(
    residuals: Residuals,
    x: F64,
    chosen: NDArray[np.bool_],
    name: str,
    colour: str,
    symbol: str = "circle",
) -> dict[str, Any]:
    labels = residuals.labels
    return points(
        x[chosen],
        residuals.value[chosen],
        name,
        text=[labels[i] for i in np.flatnonzero(chosen)],
        marker={"size": 4, "opacity": 0.6, "color": colour, "symbol": symbol},
    )


def _scatter(traces: list[dict[str, Any]], x: str, unit: str) -> Figure:
    return figure(traces, x, f"residual ({unit})", height=360)


def _running_mean(x: F64, y: F64, parts: int = 20) -> tuple[F64, F64] | None:
    if len(x) < 4 * parts or np.ptp(x) == 0.0:
        return None
    part = np.empty(len(x), dtype=np.int64)
    part[np.argsort(x, kind="stable")] = np.arange(len(x)) * parts // len(x)
    line_ = mean_line(x, y, part, parts)
    return (np.array([at for at, _ in line_]), np.array([v for _, v in line_])) if line_ else None
