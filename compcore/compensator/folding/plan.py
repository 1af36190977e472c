"""The folding plan: which effects go together, where their nodes stand, which products."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.cross import NotSeparableError, find_cross
from abbe.compcore.compensator.folding.group import EffectGroup, Interaction
from abbe.compcore.compensator.folding.metric import Metric
from abbe.compcore.compensator.folding.nodes.layout import SampledFunctions, TooManyNodesError
from abbe.compcore.compensator.folding.nodes.line import NodeLine
from abbe.compcore.compensator.folding.nodes.variable import DIRECTIONS, FoldingVariable
from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.compensator.folding.source import FoldedEffect
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

_FOR_LINES = 0.7
"""Part of the tolerance that piecewise linear lines may use; the rest is margin."""
_FOR_PRODUCTS = 0.1
_MARGIN = 0.9
"""Lines are laid out a little better than refolds will ask for."""
_MOST_NODES = 20_000
_CURVED = 1e-3
"""A line off by less than this part of the tolerance is straight between its breaks."""
_OVERTRAVEL = 0.1
"""How far outside the travel effects are followed that neither hold nor go straight there."""
_OUTSIDE = np.array([0.0, 0.02, 0.1, 0.35, 1.0])
_CORNERS = 8
_OTHERS = 3
"""Beside how many values of the other variables a line is laid out: corners, and others."""
_GRID = {2: 33, 3: 15, 4: 8}
_MOST_PIVOTS = 100_000
_INACTIVE = 1e-3


class FoldingPlan:
    """Lines and products for a model's effects, good for `states` and all between them.

    Parameters
    ----------
    tolerance
        What folding may cost, mm.
    states
        Slow states that the lines must do justice to.
    extra
        Positions that must be nodes, by axis.
    narrow
        Effect → axis → where it must have nodes (`narrow_places`); None: it fits no table.

    Attributes
    ----------
    groups
        The groups of effects, laid out.
    direct
        Effects that fit no table and are evaluated at every point.
    share
        What each line may be off by, mm.
    """

    def __init__(
        self,
        machine: Machine,
        sources: Sequence[FoldedEffect],
        error_motions: Sequence[ErrorMotion],
        metric: Metric,
        tolerance: float,
        states: Sequence[SlowState],
        extra: dict[str, list[float]],
        narrow: Mapping[FoldedEffect, dict[str, list[float]] | None],
    ) -> None:
        self._machine, self._metric = machine, metric
        self._states, self._extra = tuple(states), extra
        self._narrow = narrow
        self.direct = [
            s for s in sources if s.effect.kinks_move(machine) or narrow.get(s, {}) is None
        ]
        self.share = tolerance
        self.groups: tuple[EffectGroup, ...] = ()
        index = {error_motion: k for k, error_motion in enumerate(error_motions)}
        left = [s for s in sources if s not in self.direct]
        while True:
            groups = self._grouped(left, index)
            unfit = self._lay_out(groups, tolerance)
            if unfit is None:
                self.groups = groups
                return
            self.direct.append(unfit)
            left.remove(unfit)

    def _grouped(
        self, sources: Iterable[FoldedEffect], index: dict[ErrorMotion, int]
    ) -> tuple[EffectGroup, ...]:
        """Effects of one variable together, slow ones apart; others each for itself."""
        together: dict[object, list[FoldedEffect]] = {}
        for source in sources:
            alone = len(source.variables) > 1
            key = source if alone else (source.variables, source.reads.slow)
            together.setdefault(key, []).append(source)
        return tuple(
            EffectGroup(
                self._machine,
                own[0].variables,
                own,
                [[index[error_motion] for error_motion in source.error_motions] for source in own],
            )
            for own in together.values()
        )

    def _lay_out(self, groups: Sequence[EffectGroup], tolerance: float) -> FoldedEffect | None:
        """Lay all groups out; where one cannot be, the effect to blame."""
        interactions = {}
        several = sum(len(group.variables) > 1 for group in groups)
        for group in groups:
            try:
                own = _FOR_PRODUCTS * tolerance / several if several else 0.0
                interactions[group] = self._interactions(group, own)
            except NotSeparableError:
                return group.sources[0]
        layouts = {group: [self._layout(group, v) for v in group.variables] for group in groups}
        budget = _FOR_LINES * tolerance
        curved = sum(
            layout is not None and layout.off > _CURVED * budget
            for found in layouts.values()
            for layout, _ in found
        )
        self.share = budget / max(curved, 1)
        order = self._machine.structure.axes
        for group, found in layouts.items():
            lines = []
            for variable, (layout, beyond) in zip(group.variables, found, strict=True):
                where = order.index(variable.axis)
                travel = self._machine.axis(variable.axis).travel
                try:
                    nodes = DIRECTIONS if layout is None else self._nodes(layout)
                except TooManyNodesError:
                    return self._most_restless(group, variable)
                lines.append(NodeLine(variable, where, nodes, beyond, travel))
            group.lay_out(lines, interactions[group])
        return None

    def _nodes(self, layout: SampledFunctions) -> F64:
        return layout.nodes(_MARGIN * self.share, _MOST_NODES)

    def _states_of(self, group: EffectGroup) -> tuple[SlowState, ...]:
        """Those states that differ to a group's effects."""
        seen = {
            tuple(state.seen_by(source.reads) for source in group.sources): state
            for state in self._states
        }
        return tuple(seen.values())

    def _interactions(self, group: EffectGroup, tolerance: float) -> list[Interaction]:
        count = len(group.variables)
        if count < 2:
            return []
        states = self._states_of(group)
        found = []
        for column, error_motion in enumerate(group.error_motions):
            own = tolerance / (len(group.error_motions) * self._metric.largest(error_motion))
            active = self._active(group, column, _INACTIVE * own)
            if not active:
                continue

            def interaction(rows: F64, column: int = column, active: list[int] = active) -> F64:
                values = [group.interaction(rows, active, s)[:, column] for s in states]
                return np.stack(values)

            size = _GRID.get(len(active), 5)
            variables = [group.variables[v] for v in active]
            grids = [
                DIRECTIONS
                if v.kind == "direction"
                else np.union1d(np.linspace(*v.travel(self._machine), size), self._stated(group, v))
                for v in variables
            ]
            if math.prod(map(len, grids)) > _MOST_PIVOTS:
                raise NotSeparableError
            cross = find_cross(interaction, grids, own)
            if cross is not None:
                found.append(Interaction(column, tuple(active), cross))
        return found

    def _active(self, group: EffectGroup, column: int, tolerance: float) -> list[int]:
        """The variables that take part in what is not a sum of functions of one variable each."""
        rng = np.random.default_rng(3)
        every = range(len(group.variables))

        def some(v: FoldingVariable) -> F64:
            values = v.some(self._machine, 64, rng)
            stated = self._stated(group, v)
            if len(stated):
                values[::2] = rng.choice(stated, len(values[::2]))
            return values

        rows = np.stack([some(v) for v in group.variables], axis=1)
        active = []
        for v in every:
            other = rows.copy()
            other[:, v] = some(group.variables[v])
            for state in self._states_of(group):
                both = group.interaction(np.concatenate([rows, other]), every, state)[:, column]
                if np.abs(both[:64] - both[64:]).max() > tolerance:
                    active.append(v)
                    break
        return active

    def _stated(self, group: EffectGroup, variable: FoldingVariable) -> F64:
        """Where a group's effects are narrow along a position."""
        found = [
            (self._narrow.get(source) or {}).get(variable.axis, ())
            for source in group.sources
            if variable.kind == "position"
        ]
        return np.array(sorted({x for places in found for x in places}))

    def _layout(
        self, group: EffectGroup, variable: FoldingVariable
    ) -> tuple[SampledFunctions | None, float]:
        """Samples along a variable, and how far outside the travel its slope is measured."""
        if variable.kind == "direction":
            return None, 0.0
        low, high = variable.travel(self._machine)
        length = high - low
        breaks = {low, high}

        def profile(x: F64) -> F64:
            return self._metric.project(self._along(group, variable, x), group.error_motions)

        if variable.kind == "phase":
            return SampledFunctions(profile, self._metric.size, sorted(breaks)), 0.0
        breaks.update(self._extra.get(variable.axis, ()), self._stated(group, variable).tolist())
        for source in group.sources:
            breaks.update(source.kinks.get(variable.axis, ()))
        ends = min(breaks), max(breaks)
        outside = np.concatenate([ends[0] - length * _OUTSIDE, ends[1] + length * _OUTSIDE])
        values = profile(outside)
        straight = True
        for side in (values[: len(_OUTSIDE)], values[len(_OUTSIDE) :]):
            line = side[0] + _OUTSIDE[:, None, None] * (side[-1] - side[0])
            off = self._metric.size(side - line).max()
            straight = straight and bool(off <= 1e-9 + 1e-12 * np.abs(side).max())
        if not straight:
            breaks |= {ends[0] - _OVERTRAVEL * length, ends[1] + _OVERTRAVEL * length}
        layout = SampledFunctions(profile, self._metric.size, sorted(breaks))
        return layout, _OVERTRAVEL * length if straight else 0.0

    def _along(self, group: EffectGroup, variable: FoldingVariable, x: F64) -> F64:
        """Error motions along a variable in several states, and beside several values of others.

        Shape (x, states and others, motions).
        """
        v = group.variables.index(variable)
        found = []
        for beside in self._beside(group, v):
            rows = np.tile(beside, (len(x), 1))
            rows[:, v] = x
            found += [group.evaluate(rows, state) for state in self._states_of(group)]
        return np.stack(found, axis=1)

    def _beside(self, group: EffectGroup, v: int) -> F64:
        """Values of a group's variables other than v: corners of their ranges and some more."""
        if len(group.variables) == 1:
            return np.zeros((1, 1))
        rng = np.random.default_rng(57)
        ends = [
            (0.0,) if i == v else variable.travel(self._machine)
            for i, variable in enumerate(group.variables)
        ]
        corners = rng.permutation(list(itertools.product(*ends)))[:_CORNERS]
        some = [variable.some(self._machine, _OTHERS, rng) for variable in group.variables]
        return np.concatenate([corners, np.stack(some, axis=1)])

    def _most_restless(self, group: EffectGroup, variable: FoldingVariable) -> FoldedEffect:
        """The effect of a group that needs the most nodes along a variable."""

        def count(source: FoldedEffect) -> float:
            columns = [group.error_motions[k] for k in group.columns_of(source)]
            alone = EffectGroup(self._machine, group.variables, [source], [columns])
            layout, _ = self._layout(alone, variable)
            try:
                return 0 if layout is None else len(self._nodes(layout))
            except TooManyNodesError:
                return np.inf

        return max(group.sources, key=count)
