"""The part of an error field that depends on one axis: least squares over the working volume.

A controller without levers adds up functions of one axis each. Over a volume that is a product of
ranges, the sum that leaves least of a field e (in the mean square) is known in closed form: each
axis's function is the mean of e over all other axes, and the mean over everything counts once (the
functional analysis of variance; Sobol', Math. Comput. Simul. 55 (2001)). The part that grows evenly
with another axis's position, for tables with a lever, is e's regression slope on it; means and
slopes are orthogonal, so neither spoils the other.

The means are taken in two steps. A rough error motion of *another* axis adds, in a rigid machine,
only a straight line to what this axis sees: it needs many samples of the other axes, but few of
this one. The axis's own error motions need many samples of this one, but change only evenly with
the others. Neither needs both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.volume import Volume

F64 = NDArray[np.float64]
Evaluate = Callable[[Mapping[str, F64], Mapping[str, F64]], F64]
"""Positions and directions, each (n,) → k numbers at each row, (n, k)."""

FINE = 385
"""Positions along the axis itself."""
_MANY = 149


@dataclass(frozen=True)
class Marginal:
    """The part of an error field that depends on one axis only, the mean over the others.

    Attributes
    ----------
    axis
        The axis.
    positions
        (m,), mm or rad, over its whole travel.
    mean
        Mean over the other axes' ranges: for the axis on its way up and on its way down, shape
        (2, m, k); the two are alike where the field does not depend on the direction.
    slope
        Other axis → regression slope on it, (2, m, k), per mm or rad.
    """

    axis: str
    positions: F64
    mean: F64
    slope: Mapping[str, F64]

    def __sub__(self, other: Marginal) -> Marginal:
        slope = {b: v - other.slope[b] for b, v in self.slope.items()}
        return Marginal(self.axis, self.positions, self.mean - other.mean, slope)


def fine_positions(field: ErrorField, axis: str, more: Sequence[float] = ()) -> F64:
    """Fine positions over an axis's travel, (m,), mm or rad, effects' kinks among them."""
    low, high = field.model.machine.axis(axis).travel
    inside = [p for p in more if low < p < high]
    joined = np.concatenate([np.linspace(low, high, FINE), field.kinks(axis), inside])
    return distinct(joined, (high - low) * 1e-9)


def distinct(positions: F64, tolerance: float) -> F64:
    """Sorted positions without those that stand closer than a tolerance to the one before."""
    ordered = np.sort(positions)
    keep = np.concatenate([[True], np.diff(ordered) > tolerance])
    return np.asarray(ordered[keep])


def marginal(
    evaluate: Evaluate,
    machine: Machine,
    volume: Volume,
    axis: str,
    positions: F64,
    *,
    reverses: bool,
) -> Marginal:
    """The part of a field that depends on one axis only, by least squares over the volume.

    Parameters
    ----------
    evaluate
        The field.
    machine, volume
        The machine, and the ranges of the other axes.
    axis
        The axis.
    positions
        (m,), where it is wanted, mm or rad.
    reverses
        Whether the field depends on the axis's direction. All other directions count as not known,
        which is the mean of both.
    """
    others = [a for a in machine.structure.axes if a != axis]
    rough = 17 if is_rotary(axis) else 9
    low, high = float(positions[0]), float(positions[-1])
    nodes = np.cos((np.arange(rough)[::-1] + 0.5) * np.pi / rough)
    coarse = low + 0.5 * (nodes + 1.0) * (high - low)
    scaled = 2.0 * (positions - low) / (high - low) - 1.0
    few = {0: 1, 1: 7, 2: 7, 3: 13}.get(len(others), 31)
    parts = []
    for sign in (1.0, -1.0) if reverses else (0.0,):
        fine = _regression(evaluate, volume, axis, positions, others, few, sign)
        there = _regression(evaluate, volume, axis, coarse, others, few, sign)
        well = _regression(evaluate, volume, axis, coarse, others, _MANY, sign)
        shape = fine.shape
        amends = chebyshev.chebfit(nodes, (well - there).reshape(rough, -1), rough - 1)
        parts.append(fine + chebyshev.chebval(scaled, amends).T.reshape(shape))
    both = np.stack(parts if reverses else parts * 2)
    slope = {b: both[:, :, i + 1] for i, b in enumerate(others)}
    return Marginal(axis, positions, both[:, :, 0], slope)


def _regression(
    evaluate: Evaluate,
    volume: Volume,
    axis: str,
    at: F64,
    others: Sequence[str],
    count: int,
    sign: float,
) -> F64:
    """Mean and slopes over the other axes at each position, (m, 1 + others, k)."""
    spread = volume.spread(others, count) if others else {}
    n = len(next(iter(spread.values()))) if others else 1
    where = {axis: np.repeat(at, n), **{a: np.tile(v, len(at)) for a, v in spread.items()}}
    directions = {axis: np.full(len(at) * n, sign)} if sign else {}
    values = evaluate(where, directions)
    values = values.reshape(len(at), n, -1)
    columns = [np.ones(n)]
    columns += [(spread[a] - volume.middle(a)) / volume.half(a) for a in others]
    solve = np.linalg.pinv(np.stack(columns, axis=1))
    found = np.einsum("cn,mnk->mck", solve, values, optimize=True)
    for i, a in enumerate(others):
        found[:, i + 1] /= volume.half(a)
    return np.asarray(found)
