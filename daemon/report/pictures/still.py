"""A picture in space as a still drawing in SVG: what paper gets, which cannot be turned.

Plotly draws space with the graphics card, which a printer does not see. The same traces are
projected here along the direction in which the picture is first seen.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.daemon.report.pictures.in_a_plane import plane, sheet
from abbe.daemon.report.pictures.view import (
    GRID,
    HEIGHT,
    WIDTH,
    View,
    round_numbers,
    segments,
    text,
)

F64 = NDArray[np.float64]

_EYE = (1.25, 1.25, 1.25)
"""Where Plotly stands at first, in units of the box."""
_SHADES = 21
_NARROW = (
    "<style>@media(max-width:30rem){.still text{font-size:19px}"
    ".still path{vector-effect:non-scaling-stroke}}</style>"
)
"""On a telephone, where the drawing is half as large, its numbers and lines are not."""


def still(figure: Mapping[str, Any]) -> str:
    """The drawing of a Plotly figure whose traces are lines and markers in space, as SVG.

    Colours that stand for numbers, their scale and the axes' titles are those of the figure.
    """
    scene = figure["layout"].get("scene", {})
    traces = [t for t in figure["data"] if t.get("type") == "scatter3d"]
    drawn = [(t, _points(t)) for t in traces]
    every = np.concatenate([p for _, p in drawn]) if drawn else np.zeros((0, 3))
    known = every[np.isfinite(every).all(axis=1)]
    low, high = (known.min(axis=0), known.max(axis=0)) if len(known) else (np.zeros(3), np.ones(3))
    flat = np.ptp(np.stack([low, high]), axis=0) < 1e-9 * max(1.0, float(np.max(high - low)))
    low, high = np.where(flat, low - 0.5, low), np.where(flat, high + 0.5, high)
    eye = scene.get("camera", {}).get("eye", {})
    towards = [float(eye.get(k, e)) for k, e in zip("xyz", _EYE, strict=True)]
    corners = np.array(list(product(*zip(low, high, strict=True))))
    titles = [_title(scene, k) for k in "xyz"]
    seen = plane(flat)
    if seen is None:
        view = View.of(towards, corners)
        parts = [*_box(view, low, high, titles)]
    else:
        view = View.square(*seen, corners)
        parts = [*sheet(view, low, high, titles, seen, flat)]
    for trace, place in drawn:
        parts += _trace(trace, view(place))
    parts += _legend(traces)
    return (
        f'<svg class="still" role="img" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" '
        'xmlns="http://www.w3.org/2000/svg" font-size="12" '
        f'fill="none" stroke-linecap="round">{_NARROW}{"".join(parts)}</svg>'
    )


def _points(trace: Mapping[str, Any]) -> F64:
    return np.stack([np.asarray(trace[k], dtype=np.float64) for k in "xyz"], axis=1)


def _title(scene: Mapping[str, Any], letter: str) -> str:
    title = scene.get(f"{letter}axis", {}).get("title", letter.upper())
    return str(title.get("text", "") if isinstance(title, Mapping) else title)


def _box(view: View, low: F64, high: F64, titles: Sequence[str]) -> Iterator[str]:
    """The three planes behind, and the scales at the edges in front of them."""
    ends = np.stack([low, high])
    behind = np.where(view.towards > 0.0, 0, 1)  # the end of each axis farther from the eye
    ticks = [round_numbers(a, b) for a, b in zip(low, high, strict=True)]
    lines = []
    for fixed in range(3):
        one, two = (k for k in range(3) if k != fixed)
        for along, over in ((one, two), (two, one)):
            for value in [low[over], *ticks[over], high[over]]:
                pair = np.empty((2, 3))
                pair[:, fixed] = ends[behind[fixed], fixed]
                pair[:, over] = value
                pair[:, along] = ends[:, along]
                lines.append(pair)
    yield f'<path stroke="{GRID}" stroke-width="0.8" d="{segments(view, lines)}"/>'
    for k in range(3):
        yield from _scale(view, ends, behind, k, ticks[k], titles[k])


def _scale(
    view: View, ends: F64, behind: NDArray[np.int64], k: int, ticks: Sequence[float], title: str
) -> Iterator[str]:
    """One axis's numbers: X and Y along the floor's front edges, Z up the edge at the left."""
    edge = np.array([ends[behind[j], j] for j in range(3)])
    if k == 2:
        sides = [np.array([ends[1 - behind[0], 0], edge[1]]), np.array([edge[0], ends[1, 1]])]
        sides[1][1] = ends[1 - behind[1], 1]
        flat = [view(np.array([[*side, ends[0, 2]]]))[0, 0] for side in sides]
        edge[:2] = sides[int(np.argmin(flat))]
    else:
        other = 1 - k
        edge[other] = ends[1 - behind[other], other]
        edge[2] = ends[behind[2], 2]
    points = np.tile(edge, (len(ticks) + 1, 1))
    points[:, k] = [*ticks, 0.5 * (ends[0, k] + ends[1, k])]
    middle = view(0.5 * (ends[:1] + ends[1:]))[0]
    where = view(points)
    away = where[-1] - middle
    if k == 2:
        away = np.array([-1.0, 0.0])
    away = away / max(float(np.linalg.norm(away)), 1e-12)
    anchor = "end" if away[0] < -0.3 else "start" if away[0] > 0.3 else "middle"
    for (x, y), value in zip(where[:-1] + 12.0 * away, ticks, strict=True):
        yield text(x, y + 4.0, f"{value:g}".replace("-", "−"), anchor)
    x, y = where[-1] + (50.0 if k < 2 else 72.0) * away
    if k == 2:
        yield text(x, y + 4.0, title, "middle", turned=True)
    else:
        yield text(x, y + 4.0, title, anchor)


def _trace(trace: Mapping[str, Any], flat: F64) -> Iterator[str]:
    """A trace's lines and markers, those of one colour as one path, the strongest on top."""
    mode = str(trace.get("mode", "lines"))
    if "lines" in mode and len(flat) > 1:
        style = trace.get("line", {})
        known = _known(flat)
        whole = known[:-1] & known[1:]
        for colour, chosen in _by_colour(style, len(flat) - 1, whole):
            path = "".join(
                f"M{x:.1f} {y:.1f}L{p:.1f} {q:.1f}"
                for (x, y), (p, q) in zip(flat[:-1][chosen], flat[1:][chosen], strict=True)
            )
            wide = max(1.6, 0.6 * float(style.get("width", 0.0)))
            dashes = ' stroke-dasharray="1 6"' if style.get("dash") == "dot" else ""
            yield f'<path stroke="{colour}" stroke-width="{wide:g}"{dashes} d="{path}"/>'
    if "markers" in mode:
        style = trace.get("marker", {})
        sizes = np.broadcast_to(np.asarray(style.get("size", 4), dtype=np.float64), len(flat))
        for size in np.unique(sizes[sizes > 0.0]):
            for colour, chosen in _by_colour(style, len(flat), _known(flat) & (sizes == size)):
                path = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in flat[chosen])
                yield f'<path stroke="{colour}" stroke-width="{max(2.0, size):g}" d="{path}"/>'


def _known(flat: F64) -> NDArray[np.bool_]:
    """Which places are none of the gaps between lines."""
    return np.asarray(np.isfinite(flat).all(axis=1))


def _by_colour(
    style: Mapping[str, Any], count: int, chosen: NDArray[np.bool_]
) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Colour → which of the trace's pieces have it, the faintest first."""
    colour = style.get("color", "#0072b2")
    if isinstance(colour, str):
        yield escape(colour), chosen
        return
    values = np.asarray(colour, dtype=np.float64)[:count]
    low, high = _range(style)
    shade = np.clip(np.rint((values - low) / max(high - low, 1e-300) * (_SHADES - 1)), 0, None)
    shade = np.where(np.isfinite(shade), np.minimum(shade, _SHADES - 1), 0.0)
    middle = 0.5 * (_SHADES - 1)
    for k in sorted(np.unique(shade[chosen]), key=lambda k: abs(k - middle)):
        yield _mixed(style["colorscale"], k / (_SHADES - 1)), chosen & (shade == k)


def _range(style: Mapping[str, Any]) -> tuple[float, float]:
    if "cmin" in style and "cmax" in style:
        return float(style["cmin"]), float(style["cmax"])
    values = np.asarray(style["color"], dtype=np.float64)
    return float(np.nanmin(values)), float(np.nanmax(values))


def _mixed(scale: Sequence[tuple[float, str]], share: float) -> str:
    """The colour at a part of a scale of hexadecimal colours."""
    stops = [(float(at), _rgb(colour)) for at, colour in scale]
    at = [s for s, _ in stops]
    mixed = [round(float(np.interp(share, at, [c[i] for _, c in stops]))) for i in range(3)]
    return "#" + "".join(f"{c:02x}" for c in mixed)


def _rgb(colour: str) -> tuple[int, int, int]:
    found = re.fullmatch(r"#([0-9a-f]{2})([0-9a-f]{2})([0-9a-f]{2})", colour.lower())
    if found is None:
        raise ValueError(f"not a hexadecimal colour: {colour}")
    red, green, blue = (int(part, 16) for part in found.groups())
    return red, green, blue


def _legend(traces: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """The scale of colours, where one is asked for."""
    for trace in traces:
        style = trace.get("line", {})
        if not style.get("showscale"):
            continue
        low, high = _range(style)
        left, top, tall = WIDTH - 84.0, 70.0, HEIGHT - 160.0
        step = tall / _SHADES
        for k in range(_SHADES):
            colour = _mixed(style["colorscale"], k / (_SHADES - 1))
            y = top + tall - (k + 1) * step
            yield (
                f'<rect x="{left:g}" y="{y:.1f}" width="14" height="{step + 0.3:.1f}" '
                f'fill="{colour}"/>'
            )
        unit = style.get("colorbar", {}).get("title", {}).get("text", "")
        yield text(left + 7.0, top - 14.0, str(unit), "middle")
        for value in (low, 0.5 * (low + high), high):
            y = top + tall * (1.0 - (value - low) / max(high - low, 1e-300))
            words = f"{value:+.3g}".replace("-", "−") if abs(value) > 1e-12 else "0"
            yield text(left + 20.0, y + 4.0, words, "start")
        return
