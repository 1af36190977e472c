"""Narrow features of an effect, which samples can miss, found by interval bounds.

Tables are laid out, and checked, by samples: between two of them anything may hide. An effect that
is an expression (`Effect.expressions`) is therefore bisected until, in every box of what it reads,
straight lines between as many samples as the layout takes there are good enough. Boxes narrower
than the samples' usual distance become breaks, between which the layout takes samples anew. A sum
is looked at summand by summand, a product of functions of one position each factor by factor; what
depends on several positions in another way must change slowly over the places where products are
looked for. An effect for which all that is too much is followed point by point.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.compensator.folding.source import FoldedEffect
from abbe.compcore.effects.expressions.bounds import bounds, factors, signal_key, summands
from abbe.compcore.effects.expressions.expression import FormulaNode
from abbe.compcore.effects.expressions.interval import Interval
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]
Box = dict[str, Interval]

_SAMPLES = 16
"""Samples that a layout takes at least in each interval between breaks, and in `_WIDE`."""
_WIDE = 1.0 / 128.0
"""Part of a travel in which a layout takes so many without being asked."""
_PIVOTS = {1: 1.0 / 32.0, 2: 1.0 / 32.0, 3: 1.0 / 14.0, 4: 1.0 / 7.0}
"""Part of a travel between the places where products of so many variables are looked for."""
_SLOWLY = 0.02
"""Part of its size by which what depends on several positions may bend between those places."""
_JUMP = 1e-9
"""A box narrower than this part of the travel holds a jump: within it nothing is promised."""
_FINE = 1.0 / 64.0
"""Part of its range to which whatever is no position is divided."""
_MOST = 20_000
"""Boxes that are looked at."""
_MOST_BREAKS = 4_000
_DAYS = 4e5
"""Time on the clock for which bounds hold at first, s."""
_MARGIN = 0.25
"""How far beyond what signals are expected to do bounds hold, as a part of their range."""


@dataclass(frozen=True, eq=False)
class Ranges:
    """Ranges of time and signals that need no new proof: key of a box → least and greatest."""

    of: Mapping[str, tuple[float, float]]

    @classmethod
    def among(cls, states: Sequence[SlowState]) -> Ranges:
        """Around slow states, with a margin."""
        values: dict[str, list[float]] = {}
        for state in states:
            for key, value in _values(state):
                values.setdefault(key, []).append(value)
        wide = {}
        for key, found in values.items():
            more = _MARGIN * (max(found) - min(found))
            wide[key] = min(found) - more, max(found) + more
        early, late = wide["t"]
        wide["t"] = min(early, 0.0), max(4.0 * late, _DAYS)
        return cls(wide)

    def hold(self, state: SlowState, keys: frozenset[str]) -> bool:
        """Whether a state lies within the ranges of some keys."""
        return all(
            self.of[key][0] <= value <= self.of[key][1]
            for key, value in _values(state)
            if key in keys
        )


def _values(state: SlowState) -> list[tuple[str, float]]:
    found = [("t", state.time)]
    found += [(signal_key(name), value) for name, value in state.signals.items()]
    return found + [(signal_key(name), value) for (name, _), value in state.lags.items()]


def slow_keys(source: FoldedEffect) -> frozenset[str]:
    """What of `Ranges` an effect reads."""
    names = [*source.reads.signals, *(name for name, _ in source.reads.lags)]
    time = ["t"] if "time" in source.reads.others else []
    return frozenset([*time, *map(signal_key, names)])


class _UnprovenError(Exception):
    """No table can be proven."""


def narrow_places(
    machine: Machine, source: FoldedEffect, per_unit: float, ranges: Ranges, allowed: float
) -> dict[str, list[float]] | None:
    """Where a table of an effect needs nodes lest something narrow hides between samples.

    Parameters
    ----------
    per_unit
        The most that one unit of its error motion does in the volume, mm.
    ranges
        What time and signals may do.
    allowed
        What may go unseen, mm.

    Returns
    -------
    Axis → positions, mm or rad; None where no table can be proven.
    """
    parts = [
        (abs(coefficient) * per_unit, part)
        for coefficient, node in source.expressions() or ()
        for part in summands(node)
        if coefficient
    ]
    found: dict[str, set[float]] = {}
    proof = _Proof(machine, ranges, allowed / max(len(parts), 1))
    try:
        for size, part in parts:
            for axis, places in proof.of_summand(part, size).items():
                found.setdefault(axis, set()).update(places)
    except _UnprovenError:
        return None
    return {axis: sorted(places) for axis, places in found.items()}


class _Proof:
    """Bisects expressions of one machine."""

    def __init__(self, machine: Machine, ranges: Ranges, allowed: float) -> None:
        self._machine, self._ranges, self._allowed = machine, ranges, allowed
        self._axes = machine.structure.axes

    def of_summand(self, node: FormulaNode, size: float) -> dict[str, list[float]]:
        """Axis → breaks, for an expression of which one unit is `size` mm.

        Raises
        ------
        _UnprovenError
            When no table can be proven.
        """
        moving = self._moving(node)
        positions = [name for name in moving if name in self._axes]
        if not positions:
            return {}
        if len(moving) == 1:
            return {positions[0]: self._places(node, positions[0], size)}
        parts = factors(node)
        if any(len(self._moving(part)) > 1 for part in parts):
            self._changes_slowly(node, positions)
            return {}
        found = {}
        for axis in positions:
            beside = size
            own: list[FormulaNode] = []
            for part in parts:
                if self._moving(part) == [axis]:
                    own.append(part)
                else:
                    whole = bounds(part, self._first([part]), frozenset()).value
                    beside *= float(np.max(whole.largest))
            if not np.isfinite(beside):
                raise _UnprovenError
            found[axis] = self._places(_product(own), axis, beside)
        return found

    def _moving(self, node: FormulaNode) -> list[str]:
        """Positions and directions that an expression reads."""
        return [v for v in node.variables() if v not in ("t", "T0")]

    def _first(self, nodes: Sequence[FormulaNode]) -> Box:
        """One box with everything that some expressions read."""
        box: Box = {}
        for node in nodes:
            for name in node.variables():
                box[name] = Interval.of(*([end] for end in self._range(name)))
            for name in node.signals():
                low, high = self._ranges.of[signal_key(name)]
                box[signal_key(name)] = Interval.of([low], [high])
        return box

    def _range(self, name: str) -> tuple[float, float]:
        if name == "T0":
            return (self._machine.reference_temperature,) * 2
        if name == "t":
            return self._ranges.of["t"]
        return self._machine.axis(name).travel if name in self._axes else (-1.0, 1.0)

    def _places(self, node: FormulaNode, axis: str, size: float) -> list[float]:
        """Breaks of a function of one position; first with all else as it may be, then divided."""
        for dividing in (False, True):
            try:
                return self._bisected(node, axis, size, dividing)
            except _UnprovenError:
                if dividing or len(self._first([node])) == 1:
                    raise
        raise AssertionError

    def _bisected(self, node: FormulaNode, axis: str, size: float, dividing: bool) -> list[float]:
        whole = boxes = self._first([node])
        others = [k for k in whole if k != axis and whole[k].width[0] > 0.0] if dividing else []
        breaks: list[float] = []
        count = 0
        while len(boxes[axis].low):
            count += len(boxes[axis].low)
            if count > _MOST or len(breaks) > 2 * _MOST_BREAKS:
                raise _UnprovenError
            part = boxes[axis].width / whole[axis].width
            good = (self._missed(node, axis, size, boxes) <= self._allowed) | (part <= _JUMP)
            narrow = good & (part < _WIDE)
            breaks += [*boxes[axis].low[narrow], *boxes[axis].high[narrow]]
            boxes = {k: v.taken(~good) for k, v in boxes.items()}
            part = part[~good]
            # a wide position is cut first, then the widest of all else, then the position again
            wide = np.stack([boxes[k].width / whole[k].width for k in others] or [0.0 * part])
            cut_other = (part < _WIDE) & (wide.max(axis=0) > _FINE)
            chosen = wide.argmax(axis=0)
            masks = {k: cut_other & (chosen == i) for i, k in enumerate(others)}
            masks[axis] = ~cut_other
            boxes = _halved(boxes, masks)
        return [float(x) for x in breaks]

    def _missed(self, node: FormulaNode, axis: str, size: float, boxes: Box) -> F64:
        """What samples may miss in each box, mm."""
        found = bounds(node, boxes, frozenset([axis]))
        slope, curvature = found.along(axis)
        step = boxes[axis].width / _SAMPLES
        with np.errstate(invalid="ignore", over="ignore"):
            straight = 0.25 * slope.width * step
            bent = 0.125 * curvature.largest * step**2
            missed = np.fmin(np.fmin(straight, bent), found.value.width) * size
        return np.where(np.isnan(missed), np.inf, np.broadcast_to(missed, step.shape))

    def _changes_slowly(self, node: FormulaNode, positions: Sequence[str]) -> None:
        """Refuse what depends on several positions and bends between the places that are tried."""
        boxes = self._first([node])
        moving = self._moving(node)
        cells = round(1.0 / _PIVOTS.get(len(moving), 0.25))
        for axis in positions:
            boxes = _divided(boxes, axis, cells)
            if len(boxes[axis].low) > _MOST:
                raise _UnprovenError
        found = bounds(node, boxes, frozenset(positions))
        size = float(found.value.largest.max())
        with np.errstate(invalid="ignore", over="ignore"):
            bent = sum(0.125 * found.along(a)[1].largest * boxes[a].width ** 2 for a in positions)
        if not (np.isfinite(size) and np.all(bent <= _SLOWLY * size)):
            raise _UnprovenError


def _product(nodes: Sequence[FormulaNode]) -> FormulaNode:
    whole = nodes[0]
    for node in nodes[1:]:
        whole = FormulaNode("Mult", whole.dimension, (whole, node))
    return whole


def _halved(boxes: Box, masks: Mapping[str, NDArray[np.bool_]]) -> Box:
    """Each box cut in two along the one variable whose mask says so."""
    out = {}
    for k, v in boxes.items():
        cut = masks.get(k)
        middle = 0.5 * (v.low + v.high)
        high = v.high if cut is None else np.where(cut, middle, v.high)
        low = v.low if cut is None else np.where(cut, middle, v.low)
        out[k] = Interval(np.concatenate([v.low, low]), np.concatenate([high, v.high]))
    return out


def _divided(boxes: Box, axis: str, cells: int) -> Box:
    """Each box cut into even cells along a variable."""
    n = len(boxes[axis].low)
    out = {k: Interval(np.tile(v.low, cells), np.tile(v.high, cells)) for k, v in boxes.items()}
    step = np.repeat(np.arange(cells), n) / cells
    low, width = out[axis].low, out[axis].width
    out[axis] = Interval(low + step * width, low + (step + 1.0 / cells) * width)
    return out
