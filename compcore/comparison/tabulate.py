"""Tables of residuals by set-up, region of an axis, direction, tool, signal and time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

REGIONS = 5
"""Parts of equal length into which an axis's travel is divided."""
PARTS = 5
"""Parts with equal numbers of rows into which signals and time are divided."""


@dataclass(frozen=True, slots=True)
class ResidualGroup:
    """Residuals of some rows.

    Attributes
    ----------
    of
        What these rows have in common: ``{"axis": "X", "from": 0.0, "to": 140.0}``, …
    n
        Number of rows.
    rms, max, mean
        Root mean square, greatest absolute value and mean, in the unit of the table.
    """

    of: Mapping[str, Any]
    n: int
    rms: float
    max: float
    mean: float

    def as_dict(self) -> dict[str, Any]:
        """One flat mapping, for JSON."""
        flat = asdict(self)
        return {**flat.pop("of"), **flat}


@dataclass(frozen=True)
class ResidualTables:
    """Residuals of one kind by group; each list in natural order, empty groups left out."""

    setups: list[ResidualGroup] = field(default_factory=list)
    regions: list[ResidualGroup] = field(default_factory=list)
    directions: list[ResidualGroup] = field(default_factory=list)
    tools: list[ResidualGroup] = field(default_factory=list)
    signals: list[ResidualGroup] = field(default_factory=list)
    time: list[ResidualGroup] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """Name of the table → its groups, for JSON."""
        return {
            name: [group.as_dict() for group in getattr(self, name)]
            for name in ("setups", "regions", "directions", "tools", "signals", "time")
        }


def tables(machine: Machine, campaign: Campaign, residual: F64, rows: Mask) -> ResidualTables:
    """Tell residuals (n,), in the unit that is wanted, of some rows apart.

    Positions in mm or degrees, time in s, signals in their own units.
    """
    c = campaign.conditions

    def grouped(groups: Iterable[tuple[Mapping[str, Any], Mask]]) -> list[ResidualGroup]:
        found = []
        for of, mask in groups:
            chosen = residual[mask & rows]
            if chosen.size:
                found.append(group(of, chosen))
        return found

    return ResidualTables(
        setups=_setups(campaign, residual, rows),
        regions=grouped(_regions(machine, campaign)),
        directions=grouped(
            ({"axis": axis, "direction": sign}, values == sign)
            for axis, values in c.directions.items()
            for sign in (1, -1)
        ),
        tools=grouped(_tools(campaign)),
        signals=grouped(_signals(machine, campaign, rows)),
        time=grouped(
            ({"from": low, "to": high}, mask) for low, high, mask in _parts(c.time, rows, PARTS)
        ),
    )


def group(of: Mapping[str, Any], values: F64) -> ResidualGroup:
    """Figures of a group of at least one residual."""
    return ResidualGroup(
        of,
        int(values.size),
        float(np.sqrt(np.mean(values**2))),
        float(np.abs(values).max()),
        float(values.mean()),
    )


def _setups(campaign: Campaign, residual: F64, rows: Mask) -> list[ResidualGroup]:
    if campaign.conditions.setup is None:
        return []
    setups = campaign.conditions.setup_rows()
    index = np.flatnonzero(rows)
    number = setups.number[index]
    order = np.argsort(number, kind="stable")
    ends = np.cumsum(np.bincount(number, minlength=len(setups.index)))
    found = []
    for name in campaign.setups:
        i = setups.index.get(name)
        if i is not None:
            mine = index[order[(ends[i - 1] if i else 0) : ends[i]]]
            if mine.size:
                found.append(group({"setup": name}, residual[mine]))
    return found


def _regions(machine: Machine, campaign: Campaign) -> Iterable[tuple[dict[str, Any], Mask]]:
    for name, position in campaign.conditions.positions.items():
        low, high = machine.axes[name].travel
        unit = 180.0 / np.pi if is_rotary(name) else 1.0
        edges = np.linspace(low, high, REGIONS + 1)
        part = np.clip(np.searchsorted(edges, position, side="right") - 1, 0, REGIONS - 1)
        for k in range(REGIONS):
            ends = {"from": round(edges[k] * unit, 6), "to": round(edges[k + 1] * unit, 6)}
            yield {"axis": name, **ends}, part == k


def _tools(campaign: Campaign) -> Iterable[tuple[dict[str, Any], Mask]]:
    tool, names = np.round(campaign.conditions.tool, 6), campaign.tool_name
    code = np.zeros(campaign.n, dtype=np.int64)
    for k in range(3):
        values, own = np.unique(tool[:, k], return_inverse=True)
        code = code * len(values) + own.reshape(-1)
    _, first, number = np.unique(code, return_index=True, return_inverse=True)
    for k, row in enumerate(first):
        mask = number.reshape(-1) == k
        called = str(names[row])
        of: dict[str, Any] = {"tool": [float(v) for v in tool[row]]}
        yield of | ({"name": called} if called else {}), mask


def _signals(
    machine: Machine, campaign: Campaign, rows: Mask
) -> Iterable[tuple[dict[str, Any], Mask]]:
    for name, values in campaign.conditions.signals.items():
        if name in machine.signals:
            unit = machine.signals[name].unit
            for low, high, mask in _parts(values, rows, PARTS):
                yield {"signal": name, "unit": unit, "from": low, "to": high}, mask


def _parts(values: F64, rows: Mask, count: int) -> Iterable[tuple[float, float, Mask]]:
    """Parts with about equal numbers of rows; one part where the values do not vary."""
    if not rows.any():
        return
    edges = np.unique(np.quantile(values[rows], np.linspace(0.0, 1.0, count + 1)))
    if len(edges) == 1:
        return
    part = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    for k in range(len(edges) - 1):
        yield float(edges[k]), float(edges[k + 1]), part == k
