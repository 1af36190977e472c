"""Tables looked up for one point at a time, with Python floats and no arrays.

The rows of a table stay packed in one block of bytes, which a refold makes in microseconds; a row
becomes a tuple when it is first needed.
"""

from __future__ import annotations

import struct
from bisect import bisect_right
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.tables import (
    DirectionTable,
    FoldedAxisTable,
    FoldedTables,
    PhaseTable,
    Products,
    Table,
)

F64 = NDArray[np.float64]
Row = tuple[float, ...]
Value = Callable[[Sequence[float], Sequence[float]], float]
"""Positions and directions of one point → an error motion."""


def lazy_rows(matrix: F64) -> tuple[list[Row | None], Callable[[int], Row]]:
    """The rows of a matrix, none of them unpacked yet, and what unpacks and keeps one."""
    rows: list[Row | None] = [None] * len(matrix)
    layout = struct.Struct(f"{matrix.shape[1]}d")
    data = np.ascontiguousarray(matrix, dtype=np.float64).tobytes()

    def fetch(i: int) -> Row:
        row: Row = layout.unpack_from(data, i * layout.size)
        rows[i] = row
        return row

    return rows, fetch


def sign(direction: float) -> int:
    """1, −1 or 0."""
    return (direction > 0.0) - (direction < 0.0)


def scalar(table: Table, column: int) -> Value:
    """One column of a table as a function of one point."""
    axis = table.axis
    if isinstance(table, DirectionTable):
        by_sign = tuple(table.values[:, column].tolist())
        return lambda _, directions: by_sign[sign(directions[axis]) if directions else 0]
    one = table.one if isinstance(table, PhaseTable) else table
    nodes = one.nodes.tolist()
    rows, fetch = lazy_rows(np.stack([one.intercept[:, column], one.slope[:, column]], axis=1))

    def look_up(q: float) -> float:
        i = bisect_right(nodes, q)
        intercept, slope = rows[i] or fetch(i)
        return intercept + slope * q

    if isinstance(table, FoldedAxisTable):
        return lambda positions, _: look_up(positions[axis])
    low, high, period = table.low, table.high, table.period
    return lambda positions, _: look_up((min(max(positions[axis], low), high) - low) % period)


def phases(tables: FoldedTables) -> list[tuple[Value, int]]:
    """Functions of a phase, each with its error motion."""
    return [
        (scalar(table, j), k)
        for table, columns in tables.tables
        if isinstance(table, PhaseTable)
        for j, k in enumerate(columns)
    ]


def scalar_products(
    products: Products,
) -> Callable[[Sequence[float], Sequence[float]], list[float]]:
    """All products at one point, in their own order."""
    count = len(products.error_motions)
    pairs = [(j, j + count) for j in range(count)]
    lines = []
    by_signs = []
    for factor in products.factors:
        if isinstance(factor, DirectionTable):
            by_signs.append((factor.axis, factor.values.tolist()))
        else:
            packed = lazy_rows(np.concatenate([factor.intercept, factor.slope], axis=1))
            lines.append((factor.axis, factor.nodes.tolist(), *packed))

    def values(positions: Sequence[float], directions: Sequence[float]) -> list[float]:
        result = [1.0] * count
        for axis, nodes, rows, fetch in lines:
            q = positions[axis]
            i = bisect_right(nodes, q)
            row = rows[i] or fetch(i)
            result = [r * (row[j] + row[m] * q) for r, (j, m) in zip(result, pairs, strict=True)]
        for axis, by_sign in by_signs:
            row = by_sign[sign(directions[axis]) if directions else 0]
            result = [r * f for r, f in zip(result, row, strict=True)]
        return result

    return values


def one_row(positions: Sequence[float], directions: Sequence[float]) -> tuple[F64, F64]:
    """One point as arrays of one row, for effects that are evaluated directly."""
    row = np.array([positions], dtype=np.float64)
    return row, np.array([directions], dtype=np.float64) if directions else np.zeros_like(row)
