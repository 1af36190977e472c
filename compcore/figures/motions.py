"""Pictures of a model: error motions along each axis, the error map of a plane."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from abbe.compcore.figures.figure import COLOURS, GREY, REACH, Figure, band, figure, line, points
from abbe.compcore.machine.machine import own_component
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.error_map import ErrorMap, error_map
from abbe.compcore.model.model import Model
from abbe.compcore.model.motion_curves import MotionCurve, motion_curves


def motion_figures(model: Model) -> dict[str, Callable[[], Figure]]:
    """The error motions of each axis by name, lengths before angles; those that are zero left out.

    At the reference temperature, in the model's frame, with 95 % intervals.
    """
    made: dict[str, Callable[[], Figure]] = {}
    for axis in model.machine.structure.axes:
        curves = motion_curves(model, axis)
        for angular, name in ((False, "error motions"), (True, "angular error motions")):
            chosen = [
                c for c in curves if c.error_motion.rotation == angular and np.ptp(c.value) > 0.0
            ]
            if chosen:
                made[f"{name} of {axis}"] = partial(motions, chosen, axis)
    return made


def plane_of(model: Model) -> tuple[str, str] | None:
    """The two linear axes across which the error map is drawn; None where there are not two."""
    linear = [a for a in ("X", "Y", "Z") if a in model.machine.structure.linear]
    return (linear[0], linear[1]) if len(linear) >= 2 else None


def map_figure(model: Model) -> dict[str, Callable[[], Figure]]:
    """The error map of the plane by name; empty where there is none."""
    across = plane_of(model)
    return {} if across is None else {"error map": lambda: plane(error_map(model, across, {}))}


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
    reach = REACH * float(max(np.ptp(x), np.ptp(y)))
    moved_x, moved_y = (c + within[:, :, i] * reach / largest for i, c in enumerate((x, y)))
    traces = []
    for nodes_x, nodes_y, name, colour in (
        (x, y, "as indicated", GREY),
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
