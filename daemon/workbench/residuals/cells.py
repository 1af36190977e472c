"""Pictures of more residuals than are drawn one by one: how many lie in each cell of a picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import LENGTHS, Campaign
from abbe.compcore.figures.means import mean_line
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]
Cell = NDArray[np.uint16]

ACROSS, UP = 160, 84
"""Cells of a picture: two or three of the screen's dots each."""
SIDES = (0, 1, -1)
"""Sides of approach in the order in which they are counted: not known, from minus, from plus."""
_PARTS = 12
"""Parts of a picture with a mean each."""
_FEWEST = 6
"""Rows of a side from which on its means are drawn."""
_PAD = 0.03


@dataclass(frozen=True, eq=False)
class CellPicture:
    """A picture of residuals, and in which of its cells each row lies.

    Attributes
    ----------
    rows
        Rows of the campaign that the picture has.
    cell
        The cell of each: ``(side·UP + row of cells)·ACROSS + column``.
    ends
        What lies across, at the left and at the right.
    means
        For each of `SIDES` what lies across and the mean residual, of each part that has rows, as
        `abbe.compcore.figures.means` draws it.
    """

    rows: NDArray[np.int32]
    cell: Cell
    ends: tuple[float, float]
    means: list[list[tuple[float, float]]]

    def counted(self, chosen: Mask | None = None) -> dict[str, Any]:
        """How many rows, all or of those chosen (mask of the campaign's), lie in which cell.

        ``cell`` are the steps from one cell that has any to the next one, which are small.
        """
        cell = self.cell if chosen is None else self.cell[chosen[self.rows]]
        count = np.bincount(cell, minlength=1)
        filled = np.flatnonzero(count)
        return {
            "n": len(cell),
            "cell": np.diff(filled, prepend=0).tolist(),
            "count": count[filled].tolist(),
        }

    def as_json(self) -> dict[str, Any]:
        """What is drawn."""
        return {
            "across": ACROSS,
            "up": UP,
            "ends": list(self.ends),
            "means": [[list(point) for point in side] for side in self.means],
            **self.counted(),
        }


def across(campaign: Campaign, panel: Mapping[str, Any]) -> F64:
    """What lies across a picture, (n,): mm, degrees, h, a signal's unit, number of the set-up."""
    c = campaign.conditions
    if panel["by"] == "axis":
        at = c.position(panel["axis"])
        return np.degrees(at) if is_rotary(panel["axis"]) else at
    if panel["by"] == "signal":
        return c.signals[panel["signal"]]
    if panel["by"] == "time":
        return c.time / 3600.0
    return c.setup_rows().number.astype(np.float64)


def cell_picture(
    campaign: Campaign,
    panel: Mapping[str, Any],
    value: F64,
    component: NDArray[np.str_],
    reach: F64,
) -> CellPicture:
    """Count a picture.

    Parameters
    ----------
    panel
        As `rows.panels` lists it.
    value
        Residuals, (n,), µm or µrad.
    component
        What each row measured along, (n,).
    reach
        The greatest residual that is shown, of lengths and of rotations.
    """
    at = across(campaign, panel)
    own = (np.isin(campaign.kind, LENGTHS) == (panel["part"] == 0)) & np.isfinite(value + at)
    if "measured" in panel:
        own &= component == panel["measured"]
    rows = np.flatnonzero(own)
    x, y = at[rows], value[rows]
    ends = _ends(x)
    column = _cells((x - ends[0]) / (ends[1] - ends[0]), ACROSS)
    row = _cells(0.5 - 0.5 * y / reach[panel["part"]], UP)
    side = np.zeros(len(rows), dtype=np.int64)
    if panel["by"] == "axis":
        # the order of SIDES
        side = campaign.conditions.direction(panel["axis"])[rows].astype(np.int64) % 3
    # set-ups are beside one another by chance
    means = [[] for _ in SIDES] if panel["by"] == "setup" else _means(x, y, side, ends)
    cell = (side * UP + row) * ACROSS + column
    return CellPicture(rows.astype(np.int32), cell.astype(np.uint16), ends, means)


def share_rows(pictures: list[CellPicture]) -> None:
    """Pictures that have the same rows keep them once; against each signal they are all there."""
    for k, picture in enumerate(pictures):
        same = (p.rows for p in pictures[:k] if np.array_equal(p.rows, picture.rows))
        pictures[k] = replace(picture, rows=next(same, picture.rows))


def _ends(x: F64) -> tuple[float, float]:
    low, high = (float(x.min()), float(x.max())) if len(x) else (0.0, 0.0)
    if low == high:
        low, high = low - 0.5, high + 0.5
    pad = _PAD * (high - low)
    return low - pad, high + pad


def _cells(share: F64, count: int) -> NDArray[np.int64]:
    return np.clip((share * count).astype(np.int64), 0, count - 1)


def _means(
    x: F64, y: F64, side: NDArray[np.int64], ends: tuple[float, float]
) -> list[list[tuple[float, float]]]:
    part = _cells((x - ends[0]) / (ends[1] - ends[0]), _PARTS)
    found: list[list[tuple[float, float]]] = []
    for k in range(len(SIDES)):
        mine = side == k
        if mine.sum() < _FEWEST:
            found.append([])
            continue
        line = mean_line(x[mine], y[mine], part[mine], _PARTS)
        found.append([(round(at, 6), round(mean, 4)) for at, mean in line])
    return found
