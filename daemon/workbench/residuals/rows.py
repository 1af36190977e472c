"""Residuals row by row for the pictures of the workbench: where each row stands in all of them."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import LENGTHS, Campaign
from abbe.compcore.figures.places import places
from abbe.compcore.figures.residuals import Residuals
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

_FEWEST = 6
"""Rows from which a picture is worth its place."""
_UNITS = ("µm", "µrad")


def shown_rows(campaign: Campaign, residual: F64) -> Index:
    """Which rows are drawn: all, or of many a sample with all of the largest residuals."""
    length = np.isin(campaign.kind, LENGTHS) & np.isfinite(residual)
    angle = ~np.isin(campaign.kind, LENGTHS) & np.isfinite(residual)
    parts = [
        Residuals.of(campaign, rows, residual, residual, unit).rows
        for rows, unit in ((length, "µm"), (angle, "µrad"))
    ]
    return np.concatenate(parts)


def rows_json(campaign: Campaign, machine: Machine, rows: Index) -> dict[str, Any]:
    """Everything by which rows are drawn and told apart; positions mm or degrees, time h."""
    c = campaign.conditions
    names, setup = [""], np.zeros(len(rows), dtype=np.int64)
    if c.setup is not None:
        names, setup = list(c.setup_rows().index), c.setup_rows().number[rows]
    runs = np.zeros(len(rows), dtype=np.int64) if c.run is None else c.run[rows]
    _, first, file = np.unique(runs, return_index=True, return_inverse=True)
    u = np.zeros((campaign.n, 3)) if c.u is None else c.u
    return {
        "row": rows.tolist(),
        "part": (~np.isin(campaign.kind[rows], LENGTHS)).astype(int).tolist(),
        "units": list(_UNITS),
        "line": campaign.line[rows].tolist(),
        "files": [PurePath(campaign.file_of(int(rows[i]))).name for i in first],
        "file": file.reshape(-1).tolist(),
        "setups": names,
        "setup": setup.tolist(),
        "measured": campaign.measured_components()[rows].tolist(),
        "axes": {
            axis: {
                "unit": "°" if is_rotary(axis) else "mm",
                "at": _rounded((np.degrees(q) if is_rotary(axis) else q)[rows], 6),
                "side": c.direction(axis)[rows].astype(int).tolist(),
            }
            for axis, q in c.positions.items()
        },
        "signals": {
            name: {"unit": _unit(machine, name), "at": _rounded(values[rows], 6)}
            for name, values in c.signals.items()
            if name in machine.signals
        },
        "time": _rounded(c.time[rows] / 3600.0, 7),
        "place": _rounded(places(campaign.rows(rows), machine).ravel(), 5),
        "along": _rounded(u[rows].ravel(), 4),
    }


def values_json(campaign: Campaign, rows: Index, residual: F64) -> list[float | None]:
    """Residuals (n,), mm or rad, of some rows, in µm or µrad."""
    factor = np.where(np.isin(campaign.kind[rows], LENGTHS), 1e3, 1e6)
    return _rounded(residual[rows] * factor, 4)


def panels(
    campaign: Campaign, rows: Index, residual: F64, first: Collection[tuple[str, str]] = ()
) -> list[dict[str, Any]]:
    """The pictures of residuals, in the order in which they say something.

    Along each axis, split by what was measured; then set-ups, time and signals. `first` are axes
    and components that differ by side of approach: they come first.
    """
    found = list(_along_axes(campaign, rows, residual))
    at_first = list(first)

    def place(panel: dict[str, Any]) -> tuple[float, ...]:
        pair = (panel["axis"], panel["measured"])
        late = at_first.index(pair) if pair in at_first else len(at_first)
        # diagonals mix all components: they show that something is wrong, not what
        return (panel["part"], late, panel["measured"] == "oblique", -panel["rms"])

    found.sort(key=place)
    return [*found, *_beside_axes(campaign, rows)]


def _along_axes(campaign: Campaign, rows: Index, residual: F64) -> Iterator[dict[str, Any]]:
    component = campaign.measured_components()[rows]
    part = (~np.isin(campaign.kind[rows], LENGTHS)).astype(int)
    for axis, position in campaign.conditions.positions.items():
        at = position[rows]
        for k in (0, 1):
            for measured in ("X", "Y", "Z", "oblique"):
                mine = (part == k) & (component == measured)
                if mine.sum() < _FEWEST or np.ptp(at[mine]) == 0.0:
                    continue
                # of rows at one place of this axis nothing is seen along it
                moving = mine & (campaign.conditions.direction(axis)[rows] != 0.0)
                own = mine if moving.sum() < _FEWEST else moving
                how = "obliquely" if measured == "oblique" else f"in {measured}"
                if k and measured != "oblique":
                    how = f"about {measured}"
                yield {
                    "title": f"along {axis}, measured {how}",
                    "part": k,
                    "by": "axis",
                    "axis": axis,
                    "measured": measured,
                    "rms": float(np.sqrt(np.mean(residual[rows][own] ** 2))),
                }


def _beside_axes(campaign: Campaign, rows: Index) -> Iterator[dict[str, Any]]:
    c = campaign.conditions
    part = (~np.isin(campaign.kind[rows], LENGTHS)).astype(int)
    for k in sorted(set(part.tolist())):
        mine = rows[part == k]
        if c.setup is not None and len(np.unique(c.setup[mine])) > 1:
            yield {"title": "by set-up", "part": k, "by": "setup"}
        if np.ptp(c.time[mine]) > 0.0:
            yield {"title": "over time", "part": k, "by": "time"}
        for name, values in c.signals.items():
            if np.isfinite(values[mine]).all() and np.ptp(values[mine]) > 0.0:
                yield {"title": f"against {name}", "part": k, "by": "signal", "signal": name}


def _unit(machine: Machine, name: str) -> str:
    unit = machine.signals[name].unit
    return "°C" if unit == "degC" else unit


def _rounded(values: F64, decimals: int) -> list[float | None]:
    return [v if np.isfinite(v) else None for v in np.round(values, decimals).tolist()]
