"""The fold: a model's effects as tables, kept up to date with the slow state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.group import EffectGroup
from abbe.compcore.compensator.folding.metric import Metric, influences
from abbe.compcore.compensator.folding.narrow import Ranges, narrow_places, slow_keys
from abbe.compcore.compensator.folding.nodes.variable import FoldingVariable
from abbe.compcore.compensator.folding.plan import FoldingPlan
from abbe.compcore.compensator.folding.slow_state import (
    SlowState,
    plausible_states,
    reference_state,
)
from abbe.compcore.compensator.folding.source import FoldedEffect
from abbe.compcore.compensator.folding.tables import FoldedTables, Table
from abbe.compcore.compensator.folding.union import Union
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]

_POINTS = 300
_POINTS_OF_PRODUCTS = 2000
_TRIES = 5
_UNSEEN = 0.1
"""Of the tolerance: what may hide between samples of effects that are expressions."""
_SEEN_GOOD = 0.85
"""Of the tolerance: what random points may show, since others may be worse."""


class Fold:
    """A model's effects as tables.

    Parameters
    ----------
    model
        Its fitted effects of machine and workpiece count.
    tolerance
        What folding may cost anywhere in the volume, mm.
    reach
        Tools up to this length are reckoned with, mm.
    state
        Tool and spindle.

    Attributes
    ----------
    error_motions
        The error motions.
    signals, lags
        What the effects read.
    reads_time
        Whether an effect looks at the clock.
    plan
        Where the nodes stand, which products there are.
    tables
        As of the last `refresh`.
    """

    def __init__(self, model: Model, tolerance: float, reach: float, state: SlowState) -> None:
        self._model, self._machine = model, model.machine
        machine = model.machine
        self._tolerance = tolerance
        fitted = [t for t in model.terms if t.fitted]
        self._amends = any(t.effect.reads_model for t in fitted)
        named = dict.fromkeys([*machine.signals, *model.signals_needed()])
        probe = reference_state(machine, named)
        self._sources = [
            FoldedEffect(machine, term, fitted, probe)
            for term in fitted
            if term.effect.scope != "instrument"
        ]
        error_motions = dict.fromkeys(c for source in self._sources for c in source.error_motions)
        self.error_motions: tuple[ErrorMotion, ...] = tuple(error_motions)
        reads = [source.reads for source in self._sources]
        lags = sorted({key for r in reads for key in r.lags})
        read = {name for r in reads for name in r.signals} | {name for name, _ in lags}
        self.lags: tuple[tuple[str, float], ...] = tuple(lags)
        self.signals: tuple[str, ...] = tuple(name for name in named if name in read)
        self.reads_time = any("time" in r.others for r in reads)
        self.reach = reach
        self.lay_out(state, seen=False)

    def lay_out(self, state: SlowState, *, seen: bool, reach: float | None = None) -> None:
        """Choose nodes and products; takes tenths of a second.

        Parameters
        ----------
        state
            The present tool and spindle, and signals if they were `seen`.
        reach
            A new greatest length of tools, mm.
        """
        self.reach = self.reach if reach is None else reach
        metric = self._metric = Metric(self._machine, self.error_motions, self.reach)
        states = plausible_states(self._machine, self.signals, self.lags, state, seen=seen)
        states = [self._amended(s) for s in states]
        extra: dict[str, list[float]] = {}
        tolerance = self._tolerance
        narrow = self._narrow_places(states)
        given = self._machine, self._sources, self.error_motions, metric
        for _ in range(_TRIES):
            self._take(FoldingPlan(*given, tolerance, states, extra, narrow))
            missed = self._missed(states)
            if not missed:
                return
            for axis, positions in missed.items():
                extra.setdefault(axis, []).extend(positions)
            tolerance *= 0.7
        # an effect that hides from samples is followed point by point
        nothing = FoldingPlan(
            self._machine, (), self.error_motions, metric, tolerance, states, {}, {}
        )
        nothing.direct.extend(self._sources)
        self._take(nothing)

    def _narrow_places(
        self, states: Sequence[SlowState]
    ) -> dict[FoldedEffect, dict[str, list[float]] | None]:
        """What hides from samples in those effects that are expressions."""
        self._ranges = Ranges.among(states)
        expressed = [s for s in self._sources if s.expressions() is not None]
        self._proven = frozenset[str]().union(*map(slow_keys, expressed))
        allowed = _UNSEEN * self._tolerance / max(len(expressed), 1)
        found = {}
        for source in expressed:
            per_unit = sum(
                self._metric.largest(self.error_motions.index(c)) for c in source.error_motions
            )
            found[source] = narrow_places(self._machine, source, per_unit, self._ranges, allowed)
        return found

    def _take(self, plan: FoldingPlan) -> None:
        self.plan = plan
        self._unions: dict[FoldingVariable, Union] = {}
        self._tables: dict[object, tuple[Table, tuple[int, ...]]] = {}

    def refresh(self, state: SlowState) -> bool:
        """Bring the tables up to date; False where they no longer do the state justice.

        Then `lay_out` with this state is due.
        """
        state = self._amended(state)
        good = self._ranges.hold(state, self._proven)
        changed = [group for group in self.plan.groups if group.refresh(state)]
        unions: set[FoldingVariable] = set()
        for group in changed:
            for v, variable in enumerate(group.variables):
                if variable.kind == "position":
                    unions.add(variable)
                else:
                    self._tables[group, variable] = group.table(v), group.error_motions
                good = good and self._good(group, v)
        for variable in unions:
            union = self._unions.get(variable) or self._union(variable)
            self._tables[variable] = union.table(), union.columns
        constant = np.zeros(len(self.error_motions))
        for group in self.plan.groups:
            constant[list(group.error_motions)] += group.constant
        products = (group.products() for group in self.plan.groups)
        self.tables = FoldedTables(
            self.error_motions,
            constant,
            tuple(self._tables.values()),
            tuple(p for p in products if p is not None),
            self._direct_at(state),
        )
        return good

    @property
    def nodes(self) -> dict[str, F64]:
        """Axis → positions of the nodes of its table."""
        return {variable.axis: union.nodes for variable, union in self._unions.items()}

    def _union(self, variable: FoldingVariable) -> Union:
        members = [
            (group, group.variables.index(variable))
            for group in self.plan.groups
            if variable in group.variables
        ]
        self._unions[variable] = Union(members)
        return self._unions[variable]

    def _good(self, group: EffectGroup, v: int) -> bool:
        """Whether interpolation along a changed line is as good as it was laid out to be."""
        if not group.slow or group.variables[v].kind == "direction":
            return True
        off = self._metric.project(group.off(v)[:, None], group.error_motions)
        return bool(self._metric.size(off).max() <= self.plan.share)

    def _direct_at(self, state: SlowState) -> Callable[[F64, F64], F64] | None:
        """Those effects that fit no table, as a function of positions and directions."""
        direct = self.plan.direct
        axes = self._machine.structure.axes

        def at_points(positions: F64, directions: F64) -> F64:
            conditions = state.conditions(
                {a: positions[:, i] for i, a in enumerate(axes)},
                {a: np.sign(directions[:, i]) for i, a in enumerate(axes)},
            )
            return self._sum(direct, conditions)

        return at_points if direct else None

    def _sum(self, sources: Sequence[FoldedEffect], conditions: Conditions) -> F64:
        total = np.zeros((conditions.n, len(self.error_motions)))
        for source in sources:
            columns = [self.error_motions.index(c) for c in source.error_motions]
            total[:, columns] += source.values(conditions)
        return total

    def _amended(self, state: SlowState) -> SlowState:
        """The state as the model's effects on readings say it truly is."""
        if not self._amends:
            return state
        zero = {a: np.zeros(1) for a in self._machine.structure.axes}
        conditions = self._model.amended(state.conditions(zero, zero))
        return replace(
            state,
            signals={k: float(v[0]) for k, v in conditions.signals.items()},
            lags={k: float(v[0]) for k, v in conditions.given_lags.items()},
        )

    def _missed(self, states: list[SlowState]) -> dict[str, list[float]]:
        """Random points at which the tables are off by too much: axis → positions."""
        rng = np.random.default_rng(1866)
        axes = self._machine.structure.axes
        together = any(len(group.variables) > 1 for group in self.plan.groups)
        count = _POINTS_OF_PRODUCTS if together else _POINTS
        where = {a: FoldingVariable(a).some(self._machine, count, rng) for a in axes}
        moved = {a: FoldingVariable(a, "direction").some(self._machine, count, rng) for a in axes}
        rows = np.stack(list(where.values()), axis=1), np.stack(list(moved.values()), axis=1)
        bad = np.zeros(count, dtype=np.bool_)
        slow = [source for source in self._sources if source.reads.slow]
        still = [source for source in self._sources if not source.reads.slow]
        same = self._sum(still, states[0].conditions(where, moved))
        for state in states:
            self.refresh(state)
            truth = same + self._sum(slow, state.conditions(where, moved))
            off = self.tables.motions(*rows) - truth
            moves = influences(self._machine, self.error_motions, state.conditions(where, {}))
            error = np.einsum("nck,nk->nc", moves, off)
            bad |= np.linalg.norm(error, axis=1) > _SEEN_GOOD * self._tolerance
        return {a: where[a][bad].tolist() for a in axes} if bad.any() else {}
