"""Node lines: rows on which effects are evaluated along one variable, and their table."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.nodes.variable import FoldingVariable
from abbe.compcore.compensator.folding.tables import (
    DirectionTable,
    FoldedAxisTable,
    PhaseTable,
    Table,
)

F64 = NDArray[np.float64]

_JUMP = 3e-9
"""A segment narrower than this part of the line stands for a jump."""


@dataclass(frozen=True, eq=False)
class NodeLine:
    """The nodes of one variable's tables.

    Attributes
    ----------
    variable, index
        The variable and its axis's index among the positions.
    nodes
        Shape (n,); of a direction the three that there are.
    beyond
        How far outside the nodes the slope is measured at which positions continue (mm or rad);
        0: values are held.
    travel
        The axis's travel, mm or rad.
    """

    variable: FoldingVariable
    index: int
    nodes: F64
    beyond: float = 0.0
    travel: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def skeleton(self) -> F64:
        """The nodes, and the points outside from which slopes are measured."""
        if not self.beyond:
            return self.nodes
        ends = self.nodes[0] - self.beyond, self.nodes[-1] + self.beyond
        return np.concatenate([ends[:1], self.nodes, ends[1:]])

    @cached_property
    def points(self) -> F64:
        """The skeleton and then the middles of the segments, where interpolation is checked."""
        if self.variable.kind == "direction":
            return self.nodes
        return np.concatenate([self.skeleton, 0.5 * (self.nodes[1:] + self.nodes[:-1])])

    def off(self, values: F64) -> F64:
        """By how much interpolation misses the middles: values (points, k) → (segments, k).

        Jumps are left out: within them nothing is promised.
        """
        count = len(self.skeleton)
        inner = slice(1, count - 1) if self.beyond else slice(0, count)
        nodes = values[inner]
        off = values[count:] - 0.5 * (nodes[1:] + nodes[:-1])
        return np.asarray(off * self._wide[:, None])

    @cached_property
    def _wide(self) -> NDArray[np.bool_]:
        return np.asarray(np.diff(self.nodes) > _JUMP * (self.nodes[-1] - self.nodes[0]))

    def table(self, values: F64) -> Table:
        """The table through values on the skeleton (more rows are ignored), shape (…, k)."""
        if self.variable.kind == "direction":
            return DirectionTable(self.index, values)
        values = values[: len(self.skeleton)]
        below = above = np.zeros(values.shape[1])
        if self.beyond:
            below = (values[1] - values[0]) / self.beyond
            above = (values[-1] - values[-2]) / self.beyond
            values = values[1:-1]
        one = FoldedAxisTable.through(self.index, self.nodes, values, below, above)
        if self.variable.kind == "phase":
            return PhaseTable(one, *self.travel, self.variable.period)
        return one
