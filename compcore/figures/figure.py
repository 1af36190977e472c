"""Plotly figures as plain data, all in one style; no Plotly is imported to make them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

F64 = NDArray[np.float64]

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
"""Okabe and Ito's palette: told apart by colour-blind people, and in print."""
_FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif'
_AXIS = {
    "gridcolor": "#e6e9ec",
    "zerolinecolor": "#9aa4ae",
    "linecolor": "#57606a",
    "ticks": "outside",
    "tickcolor": "#9aa4ae",
    "automargin": True,
}

GREY = "#9aa4ae"
SIGNED = ((0.0, COLOURS[0]), (0.5, "#d8dce0"), (1.0, COLOURS[1]))
"""A scale of colours: minus, nothing, plus."""
REACH = 0.12
"""The longest vector's length in a picture, as a part of the diagonal of what it shows."""

Trace = dict[str, Any]
Figure = dict[str, Any]
"""A Plotly figure as plain data: ``{"data": [...], "layout": {...}}``."""


_FLATTEST = 0.3
"""Part of a scene's longest side that the others are drawn with at least."""
_LEGEND = 26
"""px above a picture for the names of its curves, which else lie over them."""


def figure(
    traces: Sequence[Trace],
    x: str = "",
    y: str = "",
    *,
    title: str = "",
    height: int = 420,
    **layout: Any,
) -> Figure:
    """A figure of traces on plain axes.

    Parameters
    ----------
    traces
        Plotly traces; `line` and `points` make the common ones.
    x, y
        Titles of the axes, with their units.
    height
        In pixels.
    layout
        More of Plotly's layout; its `xaxis`, `yaxis` add to the style's.
    """
    named = [t for t in traces if t.get("name") and t.get("showlegend", True)]
    above = _LEGEND if len(named) > 1 else 0
    base: dict[str, Any] = {
        "font": {"family": _FONT, "size": 13, "color": "#1b1f24"},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "colorway": list(COLOURS),
        "margin": {"l": 64, "r": 16, "t": (40 if title else 16) + above, "b": 48},
        "height": height,
        "hovermode": "closest",
        "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": "#9aa4ae", "activecolor": "#1b1f24"},
        "legend": {
            "orientation": "h",
            "itemsizing": "constant",
            "traceorder": "normal",
            "y": 1.02,
            "yanchor": "bottom",
            "x": 0,
        },
        "xaxis": {**_AXIS, "title": {"text": x}},
        "yaxis": {**_AXIS, "title": {"text": y}},
    }
    if title:
        base["title"] = {"text": title, "x": 0, "xanchor": "left"}
    for key, value in layout.items():
        if isinstance(value, Mapping):
            common = base.get(key, _AXIS if key[1:].startswith("axis") else {})
            base[key] = {**common, **value}
        else:
            base[key] = value
    return {"data": list(traces), "layout": base}


def space(points: F64, titles: Sequence[str]) -> dict[str, Any]:
    """A scene of Plotly's for points, shape (n, 3), of which NaN are gaps.

    A mm is as long along each axis. A lathe or a slit is long and flat: drawn to the volume's
    mean, as Plotly's own choice is, its ends would stand outside of the picture, and its flat side
    would have no room for the scale.
    """
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    span = high - low
    longest = float(span.max()) or 1.0
    room = np.maximum(1.04 * span, _FLATTEST * longest)
    middle = 0.5 * (low + high)
    axes = {
        f"{k}axis": {"title": {"text": title}, "range": [m - 0.5 * r, m + 0.5 * r]}
        for k, title, m, r in zip("xyz", titles, middle.tolist(), room.tolist(), strict=True)
    }
    ratio = room / room.max()
    # from far enough that no scale is cut off at the picture's edge
    away = 1.25 * max(0.75, float(np.linalg.norm(ratio)) / math.sqrt(3.0))
    camera = {"eye": dict.fromkeys("xyz", away), "center": {"x": 0.0, "y": 0.0, "z": -0.1}}
    shape = dict(zip("xyz", ratio.tolist(), strict=True))
    return {**axes, "aspectmode": "manual", "aspectratio": shape, "camera": camera}


def line(x: ArrayLike, y: ArrayLike, name: str = "", **more: Any) -> Trace:
    """A curve."""
    return {"type": "scatter", "mode": "lines", "x": x, "y": y, "name": name, **more}


def points(x: ArrayLike, y: ArrayLike, name: str = "", **more: Any) -> Trace:
    """Separate points."""
    return {"type": "scatter", "mode": "markers", "x": x, "y": y, "name": name, **more}


def band(x: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str) -> list[Trace]:
    """A shaded band between two curves, in a colour such as ``#0072b2``."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    edge = {"mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", "showlegend": False}
    fill = {"fill": "tonexty", "fillcolor": f"rgba({red},{green},{blue},0.15)"}
    return [
        {"type": "scatter", "x": x, "y": low, **edge},
        {"type": "scatter", "x": x, "y": high, **edge, **fill},
    ]
