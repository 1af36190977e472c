"""Effects that depend on the same variables, evaluated together on the rows of their lines.

A function of several variables is taken apart around an anchor:
``f(x, y, …) = f(anchor) + Σ_v (f_v − f(anchor)) + g(x, y, …)``, f_v along variable v with the
others at the anchor. The first parts go into the lines' tables; what is left, g, is a sum of
products (`abbe.compcore.compensator.folding.cross`), often none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.cross import Cross
from abbe.compcore.compensator.folding.nodes.line import NodeLine
from abbe.compcore.compensator.folding.nodes.variable import FoldingVariable
from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.compensator.folding.source import FoldedEffect
from abbe.compcore.compensator.folding.tables import (
    DirectionTable,
    FoldedAxisTable,
    Products,
    Table,
)
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]


class AnchoredRows:
    """Rows of some variables' values at which effects are evaluated, all else at its anchor."""

    def __init__(self, machine: Machine, variables: Sequence[FoldingVariable], rows: F64) -> None:
        n = len(rows)
        axes = machine.structure.axes
        self._positions = {a: np.full(n, FoldingVariable(a).anchor(machine)) for a in axes}
        self._directions = {a: np.zeros(n) for a in axes}
        for variable, column in zip(variables, rows.T, strict=True):
            if variable.kind == "direction":
                self._directions[variable.axis] = column
            elif variable.kind == "phase":
                self._positions[variable.axis] = machine.axis(variable.axis).travel[0] + column
            else:
                self._positions[variable.axis] = column

    def conditions(self, state: SlowState) -> Conditions:
        """The rows in a slow state."""
        return state.conditions(self._positions, self._directions)


@dataclass(frozen=True, eq=False)
class Interaction:
    """How one error motion's g is put together: the pivots, over those variables that matter.

    `column` is the error motion's among the group's, `active` the variables' indices.
    """

    column: int
    active: tuple[int, ...]
    cross: Cross


class EffectGroup:
    """Effects that depend on the same variables.

    Parameters
    ----------
    error_motions
        For each source the indices of its error motions among all.

    Attributes
    ----------
    error_motions
        Indices of the error motions that the group moves; columns of all values.
    slow
        Whether any of its effects changes with the slow state.
    lines
        The line of each variable.
    """

    def __init__(
        self,
        machine: Machine,
        variables: tuple[FoldingVariable, ...],
        sources: Sequence[FoldedEffect],
        error_motions: Sequence[Sequence[int]],
    ) -> None:
        self._machine = machine
        self.variables = variables
        self.sources = tuple(sources)
        self.error_motions = tuple(sorted({k for own in error_motions for k in own}))
        self._columns = [[self.error_motions.index(k) for k in own] for own in error_motions]
        self.slow = any(s.reads.slow for s in sources)
        self._anchor = np.array([[v.anchor(machine) for v in variables]])
        self.lines: tuple[NodeLine, ...] = ()
        self._interactions: tuple[Interaction, ...] = ()
        self._seen: list[tuple[object, ...] | None] = []

    def evaluate(self, rows: F64, state: SlowState) -> F64:
        """Error motions on rows (n, variables) → (n, motions)."""
        conditions = AnchoredRows(self._machine, self.variables, rows).conditions(state)
        return self._total([s.values(conditions) for s in self.sources], len(rows))

    def columns_of(self, source: FoldedEffect) -> list[int]:
        """Which of the group's columns one of its effects moves."""
        return self._columns[self.sources.index(source)]

    def _total(self, own: Sequence[F64], count: int) -> F64:
        total = np.zeros((count, len(self.error_motions)))
        for values, columns in zip(own, self._columns, strict=True):
            total[:, columns] += values
        return total

    def interaction(self, rows: F64, active: Sequence[int], state: SlowState) -> F64:
        """What is g on rows (n, len(active)), others at the anchor → (n, motions)."""
        values = self.evaluate(self._apart(rows, active), state)
        return _together(values, *rows.shape)

    def _apart(self, rows: F64, active: Sequence[int]) -> F64:
        """Rows with all active variables, then with one of them at a time, then the anchor."""
        n, d = rows.shape
        blocks = np.tile(self._anchor, ((d + 1) * n + 1, 1))
        for i, v in enumerate(active):
            blocks[:n, v] = rows[:, i]
            blocks[(i + 1) * n : (i + 2) * n, v] = rows[:, i]
        return blocks

    def lay_out(self, lines: Sequence[NodeLine], interactions: Sequence[Interaction]) -> None:
        """Take the lines and interactions to work with."""
        self.lines = tuple(lines)
        self._interactions = tuple(interactions)
        blocks = [self._anchor]
        for v, line in enumerate(self.lines):
            along = np.repeat(self._anchor, len(line.points), axis=0)
            along[:, v] = line.points
            blocks.append(along)
        self._cross_shapes = []
        for part in self._interactions:
            rows = part.cross.rows([self.lines[v].skeleton for v in part.active])
            self._cross_shapes.append(rows.shape)
            blocks.append(self._apart(rows, part.active))
        self._starts = np.cumsum([0, *(len(block) for block in blocks)]).tolist()
        every = np.concatenate(blocks)
        self._again = None
        if self._interactions:
            every, again = np.unique(every, axis=0, return_inverse=True)
            self._again = again.reshape(-1)
        self._rows = AnchoredRows(self._machine, self.variables, every)
        self._count = len(every)
        self._seen = [None] * len(self.sources)
        self._own = [np.zeros((0, 0))] * len(self.sources)

    def refresh(self, state: SlowState) -> bool:
        """Evaluate those effects anew whose conditions have changed; whether there were any."""
        conditions: Conditions | None = None
        for i, source in enumerate(self.sources):
            if self._seen[i] is not None and not source.reads.slow:
                continue
            seen = state.seen_by(source.reads)
            if seen != self._seen[i]:
                conditions = conditions or self._rows.conditions(state)
                self._own[i] = source.values(conditions)
                self._seen[i] = seen
        if conditions is None:
            return False
        total = self._total(self._own, self._count)
        self._values = total if self._again is None else total[self._again]
        return True

    @property
    def constant(self) -> F64:
        """What is added to the sum of the lines, shape (motions,)."""
        return np.asarray((1 - len(self.variables)) * self._values[0])

    def along(self, v: int) -> F64:
        """Error motions on the points of one variable's line, (points, motions)."""
        return self._values[self._starts[v + 1] : self._starts[v + 2]]

    def off(self, v: int) -> F64:
        """By how much one variable's table misses the middles of its segments, (s, motions)."""
        return self.lines[v].off(self.along(v))

    def table(self, v: int) -> Table:
        """The table of one variable."""
        return self.lines[v].table(self.along(v))

    def products(self) -> Products | None:
        """What the lines do not hold."""
        if not self._interactions:
            return None
        error_motions: list[int] = []
        factors: list[list[F64]] = [[] for _ in self.lines]
        ones = [np.ones(len(line.skeleton)) for line in self.lines]
        first = 1 + len(self.lines)
        for i, part in enumerate(self._interactions):
            block = self._values[self._starts[first + i] : self._starts[first + i + 1]]
            left = _together(block[:, [part.column]], *self._cross_shapes[i])[:, 0]
            skeletons = [self.lines[v].skeleton for v in part.active]
            for product in part.cross.products(left, skeletons):
                error_motions.append(self.error_motions[part.column])
                of = dict(zip(part.active, product, strict=True))
                for v, one in enumerate(ones):
                    factors[v].append(of.get(v, one))
        used = sorted({v for part in self._interactions for v in part.active})
        tables = [self.lines[v].table(np.stack(factors[v], axis=1)) for v in used]
        kept = tuple(t for t in tables if isinstance(t, FoldedAxisTable | DirectionTable))
        return Products(tuple(error_motions), kept)


def _together(values: F64, n: int, d: int) -> F64:
    """What is g, from the blocks of rows that `EffectGroup._apart` lays out."""
    parts = values[:-1].reshape(d + 1, n, -1)
    return np.asarray(parts[0] - parts[1:].sum(axis=0) + (d - 1) * values[-1])
