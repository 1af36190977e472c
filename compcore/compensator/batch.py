"""The correction of many points at once, from one slow state's tables.

On machines with linear axes only, to first order, the error is affine in each position that makes
up a lever: ``e = T + Σ_b q_b·U_b`` with T and U_b sums of functions of one position each. Every
axis's segment is found once for all functions; each function is then taken for itself, in chunks
that stay in the processor's cache. Other machines go through `abbe.compcore.machine.kinematics`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.compensator.folding.tables import FoldedAxisTable, FoldedTables
from abbe.compcore.machine.kinematics import Chain, exact, first_order
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Composition

F64 = NDArray[np.float64]
Index = NDArray[np.intp]

_CHUNK = 16_384
_MOST_BUCKETS = 65_536
_MOST_TIMES = 12
"""Cells that the smallest segment may have on an even grid."""
_FINEST = 1e9
"""Cells per mm beyond which cells far away could no longer be counted; bisection then."""
_ON_THE_GRID = 1e-9
"""How far from a grid's edge, in cells, a node counts as on it."""


class Finder:
    """The segment of a table in which each of many positions lies.

    Nodes that stand on an even grid, as those of a fold do between knots that are evenly spaced,
    need one multiplication and one look-up. Else a grid of buckets, each with two nodes at most,
    leaves two comparisons; where nodes stand too unevenly for that, bisection.
    """

    def __init__(self, nodes: F64) -> None:
        self._nodes = np.append(nodes, np.inf)
        self._low = float(nodes[0])
        self._bucket: Index | None = None
        self._cells = self._compare = 0
        self._even = False
        count = len(nodes) - 1
        if not count:
            return
        length = float(nodes[-1]) - self._low
        cells = _even_cells((nodes - self._low) / length)
        if cells:
            self._cells, self._even = cells, True
            if cells > count:
                middles = self._low + length / cells * (np.arange(-1, cells + 1) + 0.5)
                self._bucket = nodes.searchsorted(middles, side="right")
        cells = count
        while not (self._even or (self._cells and self._compare < 2)) and cells < _MOST_BUCKETS:
            cells *= 2
            edges = self._low + length / cells * np.arange(cells)
            below = np.append(nodes.searchsorted(edges, side="right"), len(nodes))
            crowd = int(np.diff(below).max())
            if crowd == 1 or (crowd == 2 and not self._cells):
                self._cells, self._compare = cells, crowd
                self._bucket = np.concatenate([[0], below]).astype(np.intp)
        if self._cells > _FINEST * length:
            self._cells = 0
            return
        self._per_mm = self._cells / length

    def __call__(self, position: F64) -> Index:
        """Number of nodes at or below each position, (n,); a position that is NaN: any.

        To be taken with ``mode="clip"``: outside of the nodes it may be too small or too large.
        """
        if not self._cells:
            return self._nodes[:-1].searchsorted(position, side="right")
        scaled = position * self._per_mm
        scaled += 1.0 - self._low * self._per_mm
        with np.errstate(invalid="ignore"):
            cell = scaled.astype(np.intp)
        if self._bucket is None:
            return cell
        row = self._bucket.take(cell, mode="clip")
        for _ in range(self._compare):
            row += position >= self._nodes.take(row, mode="clip")
        return row


def _even_cells(parts: F64) -> int:
    """Cells of the coarsest even grid on which nodes from 0 to 1 stand; 0: too fine a one."""
    least = float(np.diff(parts).min())
    for times in range(1, _MOST_TIMES + 1):
        if times > _MOST_BUCKETS * least:
            break
        cells = round(times / least)
        at = parts * cells
        if float(np.abs(at - np.round(at)).max()) < _ON_THE_GRID:
            return cells
    return 0


@dataclass(frozen=True, eq=False)
class _Column:
    """One function that a table's column gives: part of T (`lever` None) or of U of an axis."""

    lever: int | None
    component: int
    intercept: F64
    slope: F64


class LinearBatch:
    """Errors at many points from one state's tables, to first order, linear axes only.

    Parameters
    ----------
    at_zero
        Moves of X, Y, Z per unit of each error motion with all axes at zero, (3, motions).
    per_mm
        Their change per mm of each axis, (axes, 3, motions).
    """

    def __init__(self, tables: FoldedTables, at_zero: F64, per_mm: F64) -> None:
        self._tables = tables
        self._at_zero, self._per_mm = at_zero, per_mm
        self._ready = False

    def _prepare(self) -> None:
        """Share out the tables among the functions; not before a batch is asked for."""
        tables, at_zero, per_mm = self._tables, self._at_zero, self._per_mm
        self._constant = at_zero @ tables.constant
        self._constant_levers = per_mm @ tables.constant
        self._lines = []
        self._others = []
        self._products, self._direct = tables.products, tables.direct
        for table, columns in tables.tables:
            if isinstance(table, FoldedAxisTable):
                found = self._columns(table, list(columns))
                self._lines.append((table.axis, Finder(table.nodes), found))
            else:
                self._others.append((table, list(columns)))
        self._ready = True

    def _columns(self, table: FoldedAxisTable, error_motions: list[int]) -> list[_Column]:
        found = []
        for lever, share in [(None, self._at_zero), *enumerate(self._per_mm)]:
            for component in range(3):
                own = share[component, error_motions]
                intercept, slope = table.intercept @ own, table.slope @ own
                if intercept.any() or slope.any():
                    found.append(_Column(lever, component, intercept, slope))
        return found

    def errors(self, positions: F64, directions: F64) -> F64:
        """Moves of X, Y, Z at n points, both arguments (n, axes) → (n, 3), mm."""
        if not self._ready:
            self._prepare()
        result = np.empty((len(positions), 3))
        for start in range(0, len(positions), _CHUNK):
            rows = slice(start, start + _CHUNK)
            self._chunk(positions[rows], directions[rows], result[rows])
        return result

    def _chunk(self, positions: F64, directions: F64, result: F64) -> None:
        n = len(positions)
        q = np.ascontiguousarray(positions.T)
        error = np.repeat(self._constant[:, None], n, axis=1)
        levers: dict[tuple[int, int], F64] = {}
        for b, component in np.argwhere(self._constant_levers).tolist():
            levers[b, component] = np.full(n, self._constant_levers[b, component])
        value, slope = np.empty(n), np.empty(n)
        for axis, find, columns in self._lines:
            row = find(q[axis])
            for column in columns:
                column.intercept.take(row, out=value, mode="clip")
                column.slope.take(row, out=slope, mode="clip")
                np.multiply(slope, q[axis], out=slope)
                if column.lever is None:
                    total = error[column.component]
                else:
                    key = column.lever, column.component
                    if key not in levers:
                        levers[key] = value + slope
                        continue
                    total = levers[key]
                np.add(total, value, out=total)
                np.add(total, slope, out=total)
        for (b, component), total in levers.items():
            np.multiply(total, q[b], out=total)
            error[component] += total
        result[:] = error.T
        self._add_others(positions, directions, result)

    def _add_others(self, positions: F64, directions: F64, result: F64) -> None:
        for table, error_motions in self._others:
            self._add(table.at(positions, directions), error_motions, positions, result)
        for product in self._products:
            values = product.at(positions, directions)
            self._add(values, list(product.error_motions), positions, result)
        if self._direct is not None:
            values = self._direct(positions, directions)
            self._add(values, list(range(values.shape[1])), positions, result)

    def _add(self, values: F64, error_motions: list[int], positions: F64, result: F64) -> None:
        result += values @ self._at_zero[:, error_motions].T
        for b, share in enumerate(self._per_mm):
            own = share[:, error_motions]
            if own.any():
                result += (values @ own.T) * positions[:, b : b + 1]


class ChainBatch:
    """Errors at many points from one state's tables, on any machine, composed either way."""

    def __init__(
        self, machine: Machine, composition: Composition, tables: FoldedTables, state: SlowState
    ) -> None:
        self._machine, self._tables, self._state = machine, tables, state
        self._compose = exact if composition == "exact" else first_order

    def errors(self, positions: F64, directions: F64) -> F64:
        """Moves of X, Y, Z at n points, both arguments (n, axes) → (n, 3), mm."""
        result = np.empty((len(positions), 3))
        for start in range(0, len(positions), _CHUNK):
            rows = slice(start, start + _CHUNK)
            result[rows] = self._chunk(positions[rows], directions[rows])
        return result

    def _chunk(self, positions: F64, directions: F64) -> F64:
        values = self._tables.motions(positions, directions)
        motions = {
            error_motion: values[:, k] for k, error_motion in enumerate(self._tables.error_motions)
        }
        where = {a: positions[:, i] for i, a in enumerate(self._machine.structure.axes)}
        chain = Chain(self._machine, self._state.conditions(where, {}))
        error = self._compose(chain, motions)[0]
        return chain.as_moves(error)
