"""One axis's table out of the tables of all groups of effects that depend on its position."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.group import EffectGroup
from abbe.compcore.compensator.folding.nodes.distinct import increasing
from abbe.compcore.compensator.folding.tables import FoldedAxisTable

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

    def __init__(self, members: Sequence[tuple[EffectGroup, int]]) -> None:
        self.columns = tuple(sorted({k for group, _ in members for k in group.error_motions}))
        self.nodes = increasing(np.concatenate([group.lines[v].nodes for group, v in members]))
        self._axis = members[0][0].lines[members[0][1]].index
        parts = [_GroupTable.of(group, v, self) for group, v in members]
        self._slow = [part for part in parts if part.group.slow]
        empty = np.zeros((len(self.nodes) + 1, len(self.columns)))
        self._still = FoldedAxisTable(self._axis, self.nodes, empty, empty.copy())
        for part in parts:
            if not part.group.slow:
                part.add_to(self._still)

    def table(self) -> FoldedAxisTable:
        """The table as the groups stand now."""
        still = self._still
        if not self._slow:
            return still
        found = FoldedAxisTable(self._axis, self.nodes, still.intercept.copy(), still.slope.copy())
        for part in self._slow:
            part.add_to(found)
        return found


@dataclass(frozen=True, eq=False)
class _GroupTable:
    """One group's table as a part of a union.

    Attributes
    ----------
    rows
        The group's own segment in which each of the union's segments lies.
    columns
        Which of the union's columns the group's are.
    """

    group: EffectGroup
    v: int
    rows: NDArray[np.intp]
    columns: list[int]

    @classmethod
    def of(cls, group: EffectGroup, v: int, union: Union) -> _GroupTable:
        own = group.lines[v].nodes.searchsorted(union.nodes, side="right")
        columns = [union.columns.index(k) for k in group.error_motions]
        return cls(group, v, np.append(0, own), columns)

    def add_to(self, total: FoldedAxisTable) -> None:
        """Add the group's table, as it stands now, to one with the union's nodes and columns."""
        own = self.group.table(self.v)
        if isinstance(own, FoldedAxisTable):
            total.intercept[:, self.columns] += own.intercept[self.rows]
            total.slope[:, self.columns] += own.slope[self.rows]
