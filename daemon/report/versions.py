"""A picture of a model's versions: errors on fitted and held-out campaigns, the noise floor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.figures.figure import COLOURS, Trace, figure, line
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
    floors = [number_of(r, "noise_floor") for _, r in reported]
    if any(v is not None for v in floors):
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
        },
        yaxis={"rangemode": "tozero"},
    )


def change(record: Mapping[str, Any]) -> str:
    """What made the version, in one line."""
    for key, sign in (("added", "+"), ("removed", "−")):
        if record.get(key):
            return f"{sign} {record[key]}"
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
        "text": ["" if v is None else f"{v:.3g}" for v in values],
        "textposition": "inside",
        "insidetextanchor": "start",
        "textangle": 0,
        "textfont": {"color": ink},
        "hovertext": labels,
        "hovertemplate": "%{hovertext}<br>%{y:.4g} µm",
    }


def _floor(at: F64, floors: Sequence[float | None]) -> Trace:
    """A level across each version's bars: campaigns differ in their noise."""
    x = np.stack([at - 0.5, at + 0.5], axis=1).ravel()
    y = np.repeat(np.array([np.nan if v is None else v for v in floors]), 2)
    return line(x, y, "noise floor", line={"color": "#1b1f24", "dash": "dash", "width": 2})


def _tick(number: int, record: Mapping[str, Any]) -> str:
    """The version's number, and its change with one KEY=VALUE a line."""
    parts = change(record).split(" ")
    sign = parts[0] in ("+", "−")
    first, rest = (" ".join(parts[:2]), parts[2:]) if sign else (" ".join(parts), [])
    return "<br>".join([f"<b>{number}</b>", *(_short(p) for p in (first, *rest[:3]))])


def _short(text: str, most: int = 24) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"
