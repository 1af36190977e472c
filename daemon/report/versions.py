"""A picture of a model's versions: errors on fitted and held-out campaigns, the noise floor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.figures.figure import COLOURS, Trace, figure
from abbe.compcore.units import in_digits
from abbe.daemon.report.page import Figure

F64 = NDArray[np.float64]

_NAMED = 8
"""Versions whose change has room below the picture; more bear their number alone."""


def error_of_versions(records: Sequence[Mapping[str, Any]]) -> Figure | None:
    """RMS of the residuals of lengths, µm, version by version; None where no version tells one.

    Parameters
    ----------
    records
        The ``[[history]]`` of a model and its ``[fit]``, oldest first; a version is called by its
        place here, from 1, also where an earlier one was not fitted.
    """
    reported = [(k, r) for k, r in enumerate(records, start=1) if number_of(r, "rms") is not None]
    if not reported:
        return None
    at = np.arange(1.0, len(reported) + 1.0)
    labels = [f"{k}: {change(r)}" for k, r in reported]
    traces = [
        _bars(
            at,
            [number_of(r, "rms") for _, r in reported],
            "fitted campaigns",
            COLOURS[0],
            "#fff",
            labels,
        )
    ]
    held = [number_of(r, "holdout_rms") for _, r in reported]
    if any(v is not None for v in held):
        traces.append(_bars(at, held, "held-out campaigns", COLOURS[4], "#1b1f24", labels))
    two = any(v is not None for v in held)
    sides = ((-0.5, 0.0), (0.0, 0.5)) if two else ((-0.5, 0.5),)
    floors = [
        (side, [floor_of(r, key) for _, r in reported])
        for side, key in zip(sides, ("noise_floor", "holdout_noise_floor"), strict=False)
    ]
    if any(v is not None for _, values in floors for v in values):
        traces.append(_floor(at, floors))
    ticks = [_tick(k, r) if len(reported) <= _NAMED else str(k) for k, r in reported]
    return figure(
        traces,
        "version",
        "rms of the residuals in µm",
        height=400,
        bargap=0.45 if len(reported) > 2 else 0.7,
        bargroupgap=0.06,
        xaxis={
            "tickvals": at,
            "ticktext": ticks,
            "range": [0.5, len(reported) + 0.5],
            "showgrid": False,
            # below what made each version, which may have several lines
            "title": {"text": "version", "standoff": 12},
        },
        yaxis={"rangemode": "tozero"},
    )


def change(record: Mapping[str, Any]) -> str:
    """What made the version, in one line."""
    for key, sign in (("added", "+"), ("removed", "−")):
        if record.get(key):
            return f"{sign} {record[key]}"
    if record.get("effects") == 0:
        return "no effects"
    return f"imported from {record['map']}" if record.get("map") else "fitted"


def number_of(record: Mapping[str, Any], key: str) -> float | None:
    """A number of a record; None where it has none."""
    value = record.get(key)
    return float(value) if isinstance(value, int | float) else None


def _bars(
    at: F64,
    values: Sequence[float | None],
    name: str,
    colour: str,
    ink: str,
    labels: Sequence[str],
) -> Trace:
    return {
        "type": "bar",
        "x": at,
        "y": values,
        "name": name,
        "marker": {"color": colour},
        "text": ["" if v is None else f"{in_digits(v)}" for v in values],
        "textposition": "inside",
        "insidetextanchor": "start",
        "textangle": 0,
        "textfont": {"color": ink},
        "hovertext": labels,
        "hovertemplate": "%{hovertext}<br>%{in_digits(y, 4)} µm",
    }


def floor_of(record: Mapping[str, Any], key: str) -> float | None:
    """The noise floor of a version's fitted or held-out campaigns together, µm.

    `key` is ``noise_floor``, which the record tells, or ``holdout_noise_floor``, which follows from
    those of the held-out campaigns, each by its number of rows.
    """
    if key == "noise_floor":
        return number_of(record, key)
    stated = [(number_of(c, "noise_floor"), number_of(c, "n")) for c in record.get("holdout", ())]
    known = [(f, n) for f, n in stated if f is not None and n]
    if not known or len(known) < len(stated):
        return None
    return float(np.sqrt(sum(n * f * f for f, n in known) / sum(n for _, n in known)))


def _floor(at: F64, floors: Sequence[tuple[tuple[float, float], Sequence[float | None]]]) -> Trace:
    """A level across each bar: campaigns differ in their noise."""
    x, y = [], []
    for i, middle in enumerate(at.tolist()):
        for (left, right), values in floors:
            level = values[i]
            if level is not None:
                x += [middle + left, middle + right, None]
                y += [level, level, None]
    style = {"color": "#1b1f24", "dash": "dash", "width": 2}
    return {"type": "scatter", "mode": "lines", "x": x, "y": y, "name": "noise floor",
            "line": style}  # fmt: skip


def _tick(number: int, record: Mapping[str, Any]) -> str:
    """The version's number, and its change with one KEY=VALUE a line."""
    parts = change(record).split(" ")
    sign = parts[0] in ("+", "−")
    first, rest = (" ".join(parts[:2]), parts[2:]) if sign else (" ".join(parts), [])
    return "<br>".join([f"<b>{number}</b>", *(_short(p) for p in (first, *rest[:3]))])


def _short(text: str, most: int = 24) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"
