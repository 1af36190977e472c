"""One axis's table out of the tables of all groups of effects that depend on its position."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from compcore.folding.group import Group
from compcore.folding.tables import AxisTable

F64 = NDArray[np.float64]


class Union:
    """The sum of several groups' tables of one axis, on all of their nodes.

    A sum of piecewise linear functions is one on the union of their nodes: nothing is lost. Groups
    that do not change are summed once.

    Parameters
    ----------
    members
        Groups and which of their lines is the axis's; all evaluated already.

    Attributes
    ----------
    columns
        The error motions, as indices, that the table's columns belong to.
    nodes
        Positions, mm or rad, increasing.
    """

    def __init__(self, members: Sequence[tuple[Group, int]]) -> None:
        self.columns = tuple(sorted({k for group, _ in members for k in group.channels}))
        self.nodes = np.unique(np.concatenate([group.lines[v].nodes for group, v in members]))
        self._axis = members[0][0].lines[members[0][1]].index
        self._slow = [(group, v) for group, v in members if group.slow]
        self._still = self._sum([(group, v) for group, v in members if not group.slow])

    def _sum(self, members: Sequence[tuple[Group, int]]) -> F64:
        """Values at the nodes, then the slopes below and above them, (nodes + 2, columns)."""
        total = np.zeros((len(self.nodes) + 2, len(self.columns)))
        for group, v in members:
            own = group.table(v)
            if isinstance(own, AxisTable):
                at = [self.columns.index(k) for k in group.channels]
                total[:-2, at] += own.look_up(self.nodes)
                total[-2:, at] += own.slope[[0, -1]]
        return total

    def table(self) -> AxisTable:
        """The table as the groups stand now."""
        total = self._still + self._sum(self._slow) if self._slow else self._still
        return AxisTable.through(self._axis, self.nodes, total[:-2], total[-2], total[-1])
