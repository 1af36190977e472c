"""Folded tables: per-axis tables of error motions, and products of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.error_motion import ErrorMotion

F64 = NDArray[np.float64]

_STEP = 1e-11
"""A segment narrower than this part of the table is a step: its slope would be mere rounding."""


@dataclass(frozen=True, eq=False)
class FoldedAxisTable:
    """Piecewise linear functions of one axis's position.

    Attributes
    ----------
    axis
        Index of the axis among the positions.
    nodes
        Shape (n,), mm or rad, increasing.
    intercept, slope
        Shape (n + 1, k): function j is ``intercept[i, j] + slope[i, j]·q`` where i nodes lie at or
        below q; the first and last segments reach beyond all nodes.
    """

    axis: int
    nodes: F64
    intercept: F64
    slope: F64

    @classmethod
    def through(cls, axis: int, nodes: F64, values: F64, below: F64, above: F64) -> FoldedAxisTable:
        """The table with `values` (n, k) at the nodes and slopes `below` and `above` (k,) them."""
        widths = nodes[1:] - nodes[:-1]
        inner = (values[1:] - values[:-1]) / widths[:, None]
        inner[widths < _STEP * (nodes[-1] - nodes[0])] = 0.0
        slope = np.concatenate([below[None], inner, above[None]])
        at = np.concatenate([nodes[:1], nodes])[:, None]
        intercept = np.concatenate([values[:1], values]) - slope * at
        return cls(axis, nodes, intercept, slope)

    def at(self, positions: F64, directions: F64) -> F64:
        """The functions at n points, both arguments (n, axes) → (n, k)."""
        return self.look_up(positions[:, self.axis])

    def look_up(self, position: F64) -> F64:
        """The functions at positions (n,) of the axis itself → (n, k)."""
        row = np.searchsorted(self.nodes, position, side="right")
        return np.asarray(self.intercept[row] + self.slope[row] * position[:, None])


@dataclass(frozen=True, eq=False)
class PhaseTable:
    """Functions of one axis's position that repeat, held at the ends of the travel.

    Attributes
    ----------
    one
        The functions over one period from `low` on.
    low, high
        The axis's travel, mm or rad.
    period
        mm or rad.
    """

    one: FoldedAxisTable
    low: float
    high: float
    period: float

    @property
    def axis(self) -> int:
        """Index of the axis among the positions."""
        return self.one.axis

    def at(self, positions: F64, directions: F64) -> F64:
        """The functions at n points, both arguments (n, axes) → (n, k)."""
        held = np.clip(positions[:, self.axis], self.low, self.high)
        return self.one.look_up((held - self.low) % self.period)


@dataclass(frozen=True, eq=False)
class DirectionTable:
    """Functions of one axis's approach direction.

    `values` has a row for direction 0, 1 and −1 each, shape (3, k).
    """

    axis: int
    values: F64

    def at(self, positions: F64, directions: F64) -> F64:
        """The functions at n points, both arguments (n, axes) → (n, k); only signs count."""
        return np.asarray(self.values[np.sign(directions[:, self.axis]).astype(np.int64)])


Table = FoldedAxisTable | PhaseTable | DirectionTable


@dataclass(frozen=True, eq=False)
class Products:
    """Products of functions of one variable each.

    Attributes
    ----------
    error_motions
        The error motion to which each product is added.
    factors
        One table for each variable, with a column for each product.
    """

    error_motions: tuple[int, ...]
    factors: tuple[FoldedAxisTable | DirectionTable, ...]

    def at(self, positions: F64, directions: F64) -> F64:
        """The products at n points, both arguments (n, axes) → (n, products)."""
        value = self.factors[0].at(positions, directions)
        for factor in self.factors[1:]:
            value = value * factor.at(positions, directions)
        return value


@dataclass(frozen=True, eq=False)
class FoldedTables:
    """All error motions of a machine in one slow state.

    ``motion_k = constant_k + Σ tables_k + Σ products_k + direct_k``

    Attributes
    ----------
    error_motions
        The error motions k.
    constant
        Shape (motions,), mm or rad.
    tables
        Each with the indices of the error motions that its columns belong to.
    direct
        For what fits no table: positions and directions (n, axes) → error motions (n, motions).
    """

    error_motions: tuple[ErrorMotion, ...]
    constant: F64
    tables: tuple[tuple[Table, tuple[int, ...]], ...] = ()
    products: tuple[Products, ...] = ()
    direct: Callable[[F64, F64], F64] | None = None

    def motions(self, positions: F64, directions: F64) -> F64:
        """Every error motion at n points, both arguments (n, axes) → (n, motions), mm or rad."""
        total = np.tile(self.constant, (len(positions), 1))
        for table, columns in self.tables:
            total[:, columns] += table.at(positions, directions)
        for products in self.products:
            values = products.at(positions, directions)
            for i, k in enumerate(products.error_motions):
                total[:, k] += values[:, i]
        if self.direct is not None:
            total += self.direct(positions, directions)
        return total
