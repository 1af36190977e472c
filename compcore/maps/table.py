"""Tables of a CMM's compensation map: per axis, positions and six errors at each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Row = tuple[float, float, float, float, float, float]

COLUMNS = ("Lx", "Ly", "Lz", "Rx", "Ry", "Rz")
"""A map's columns: linear errors along X, Y, Z, then angular errors about X, Y, Z."""
COMPONENTS = "XYZABC"
"""The same as ISO letters of error motions."""


@dataclass(frozen=True, slots=True)
class AxisTable:
    """The compensation table of one axis: linear between rows, the end rows held beyond them.

    Attributes
    ----------
    axis
        Axis name.
    positions
        mm, rising or falling, never both.
    values
        A row (Lx, Ly, Lz in mm, Rx, Ry, Rz in rad) for each position.
    line
        Line of the heading in the file, for people.
    """

    axis: str
    positions: tuple[float, ...]
    values: tuple[Row, ...]
    line: int | None = None

    @property
    def range(self) -> tuple[float, float]:
        """Least and greatest position of the table, mm."""
        return min(self.positions) + 0.0, max(self.positions) + 0.0

    def rising(self) -> AxisTable:
        """The same table with its positions in rising order."""
        if self.positions[0] < self.positions[-1]:
            return self
        up = tuple(p + 0.0 for p in self.positions[::-1])  # −0.0000, as some maps write, is 0
        return replace(self, positions=up, values=self.values[::-1])

    def array(self) -> F64:
        """The values, shape (rows, 6), mm and rad."""
        return np.array(self.values, dtype=np.float64)

    def at(self, position: F64) -> F64:
        """Values at positions (n,), mm → (n, 6), mm and rad."""
        up = self.rising()
        table = up.array()
        columns = [np.interp(position, up.positions, table[:, k]) for k in range(6)]
        return np.stack(columns, axis=1)

    def scaled(self, factors: Sequence[float]) -> AxisTable:
        """Every column multiplied by its own factor (six, unit-free)."""
        return self.with_array(self.array() * np.asarray(factors))

    def with_array(self, values: F64) -> AxisTable:
        """The same positions with other values, shape (rows, 6), mm and rad."""
        rows: list[Row] = []
        for a, b, c, d, e, f in values.tolist():
            rows.append((a, b, c, d, e, f))
        return replace(self, values=tuple(rows))


@dataclass(frozen=True)
class CompensationMap:
    """A compensation map: axis → its table, in the file's order; `source` is the file."""

    tables: Mapping[str, AxisTable]
    source: str | None = None

    def replaced(self, *tables: AxisTable) -> CompensationMap:
        """The map with the tables of some axes replaced."""
        return replace(self, tables={**self.tables, **{t.axis: t for t in tables}})
