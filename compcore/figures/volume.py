"""The picture of a volume's errors: the box as indicated, as it is, and an arrow at each node."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.figures.figure import COLOURS, GREY, REACH, Figure, figure, line, space
from abbe.compcore.model.error_volume import ErrorVolume

F64 = NDArray[np.float64]

_STRENGTH = ((0.0, "#f0c9a8"), (1.0, COLOURS[1]))


def enlargement(found: ErrorVolume) -> float:
    """So many times larger than the box are its errors drawn."""
    diagonal = float(np.linalg.norm(np.ptp(found.nodes, axis=0)))
    return REACH * max(diagonal, 1.0) / max(found.largest, 1e-9)


def volume(found: ErrorVolume) -> Figure:
    """The errors in space, enlarged; can be turned. Of one axis: each component along its line."""
    if sum(map(bool, found.axes)) == 1:
        return _along_the_line(found)
    larger = enlargement(found)
    end = found.nodes + larger * found.error
    size = np.linalg.norm(found.error, axis=1) * 1e3
    arrows = np.stack([found.nodes, end, np.full_like(end, np.nan)], axis=1).reshape(-1, 3)
    traces = [
        _lines(found.lines[found.edges], "as indicated", {"color": GREY, "width": 2}),
        _lines(
            found.lines + larger * found.line_error,
            f"as it is, errors × {larger:.0f}",
            {"color": COLOURS[0], "width": 3},
        ),
        {
            **_path(arrows, "error"),
            "line": {
                "width": 4,
                "color": np.repeat(size, 3),
                "colorscale": [list(stop) for stop in _STRENGTH],
                "cmin": 0.0,
                "cmax": max(float(size.max()), 1e-9),
                "showscale": True,
                "colorbar": {"title": {"text": "µm"}, "thickness": 14},
            },
        },
    ]
    moved = found.lines + larger * found.line_error
    drawn = np.concatenate([arrows, found.lines.reshape(-1, 3), moved.reshape(-1, 3)])
    names = [f"{a or k} (mm)" for k, a in zip("XYZ", found.axes, strict=True)]
    return figure(traces, height=620, scene=space(drawn, names))


def _along_the_line(found: ErrorVolume) -> Figure:
    k = next(i for i, axis in enumerate(found.axes) if axis)
    at, error = found.lines[0][:, k], found.line_error[0] * 1e3
    traces = [
        line(at, error[:, i], f"in {letter}", line={"color": COLOURS[i], "width": 2.5})
        for i, letter in enumerate("XYZ")
    ]
    return figure(traces, f"{found.axes[k]} (mm)", "error (µm)", height=360)


def _lines(lines: F64, name: str, style: dict[str, Any]) -> dict[str, Any]:
    gaps = np.full((len(lines), 1, 3), np.nan)
    return {**_path(np.concatenate([lines, gaps], axis=1).reshape(-1, 3), name), "line": style}


def _path(path: F64, name: str) -> dict[str, Any]:
    x, y, z = path.T
    return {"type": "scatter3d", "mode": "lines", "name": name, "hoverinfo": "skip",
            "x": x, "y": y, "z": z}  # fmt: skip
