"""A simulated control that compensates: its tables, read its own way, and what they add where.

It takes the files of Abbe's ``csv`` dialect with ``holds = "moves"``, absolute entries and a column
for each direction: what is added to X, Y or Z as a function of one axis's position, linear between
points, the ends held. The control shifts its setpoint: it adds the compensation, −error.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

_COLUMN = re.compile(r"E_([XYZ])([XYZ])(?: \((\+|-)\))? \[mm\]")
_HEAD = {
    "format": ("abbe-table/1",),
    "sign": ("error", "compensation"),
    "holds": ("moves",),
    "entries": ("absolute",),
    "reversal": ("columns",),
}


class NotATableError(ValueError):
    """The control does not understand a file."""


@dataclass(frozen=True)
class AppliedCurve:
    """The compensation of one axis as a function of another's position, mm."""

    adds_to: str
    positions: tuple[float, ...]
    up: tuple[float, ...]
    down: tuple[float, ...]

    def at(self, position: float, direction: int) -> float:
        """The value at a position (mm), for a direction (1 up, −1 down)."""
        values = self.down if direction < 0 else self.up
        right = bisect_right(self.positions, position)
        if right == 0:
            return values[0]
        if right == len(values):
            return values[-1]
        left = right - 1
        span = self.positions[right] - self.positions[left]
        part = (position - self.positions[left]) / span
        return values[left] + part * (values[right] - values[left])


class AppliedCompensation:
    """The compensation that a set of files adds.

    Parameters
    ----------
    files
        Name → text.

    Raises
    ------
    NotATableError
        With file, line and what is wrong.
    """

    def __init__(self, files: Mapping[str, str]) -> None:
        self.curves: dict[str, list[AppliedCurve]] = {}
        for name, text in sorted(files.items()):
            axis, curves = _read(name, text)
            if axis in self.curves:
                raise NotATableError(f"{name}: a second table for {axis}")
            self.curves[axis] = curves

    def correction(
        self, position: Mapping[str, float], direction: Mapping[str, int]
    ) -> dict[str, float]:
        """What is added to each axis at a position, mm."""
        total = dict.fromkeys(position, 0.0)
        for axis, curves in self.curves.items():
            for curve in curves:
                total[curve.adds_to] += curve.at(position[axis], direction.get(axis, 1))
        return total


def _read(name: str, text: str) -> tuple[str, list[AppliedCurve]]:
    stated: dict[str, str] = {}
    titles: list[str] = []
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.startswith("#"):
            key, _, rest = line[1:].partition("=")
            stated[key.strip()] = rest.partition("#")[0].strip().strip('"')
        elif not titles:
            titles = line.split(",")
        elif line:
            try:
                rows.append([float(part) for part in line.split(",")])
            except ValueError:
                raise NotATableError(f"{name}, line {number}: not numbers") from None
            if len(rows[-1]) != len(titles):
                raise NotATableError(f"{name}, line {number}: {len(rows[-1])} columns")
    for key, allowed in _HEAD.items():
        if stated.get(key) not in allowed:
            raise NotATableError(f"{name}: {key} {stated.get(key)!r} is not for this control")
    axis = titles[0][:1] if titles and titles[0] in ("X [mm]", "Y [mm]", "Z [mm]") else ""
    places = tuple(row[0] for row in rows)
    if not axis or not rows or any(b <= a for a, b in pairwise(places)):
        raise NotATableError(f"{name}: no axis, or positions that do not rise")
    turn = -1.0 if stated["sign"] == "error" else 1.0
    columns: dict[str, dict[str, tuple[float, ...]]] = {}
    for k, title in enumerate(titles[1:], start=1):
        match = _COLUMN.fullmatch(title)
        if match is None or match[2] != axis:
            raise NotATableError(f"{name}: column {title!r}")
        columns.setdefault(match[1], {})[match[3] or "+"] = tuple(turn * row[k] for row in rows)
    return axis, [
        AppliedCurve(adds_to, places, ways["+"], ways.get("-", ways["+"]))
        for adds_to, ways in columns.items()
    ]
