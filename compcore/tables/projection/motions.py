"""The six error motions of every axis, for controllers that apply their own levers (L-VOL).

A rigid machine's model holds them as it is. What an axis's tables cannot hold (an error motion
that depends on another axis, a shift at the functional point) is spread over the tables so that
least of it remains over the volume, at the stated tool (ISO/TR 16907, 7: where the controller holds
only a rigid model, choose the tables that minimise the residual of the real machine).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.error_motion import Component, ErrorMotion
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import own_component
from abbe.compcore.multilinear import interpolate
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.projection.curves.hats import hats
from abbe.compcore.tables.projection.curves.marginal import marginal
from abbe.compcore.tables.volume import Volume

F64 = NDArray[np.float64]

LETTERS: tuple[Component, ...] = ("X", "Y", "Z", "A", "B", "C")
_POINTS = 610
_COARSE = 9
_NOTHING = 5e-5
"""mm: a remainder below this needs no spreading, half of what interpolation may cost."""
_RCOND = 1e-10


@dataclass(frozen=True, eq=False)
class AxisMotions:
    """The six error motions of one axis at fine positions, mm and rad.

    Attributes
    ----------
    axis, positions
        The axis and where, (m,), mm or rad.
    values
        Upwards and downwards, (2, m, 6), mm and rad; X Y Z A B C.
    """

    axis: str
    positions: F64
    values: F64

    def at(self, positions: F64, upward: F64) -> F64:
        """Values at n positions, (n, 6); `upward` (n,) is 1, 0 or ½ (unknown)."""
        found = [
            np.stack(
                [interpolate((self.positions,), v[:, k], (positions,)) for k in range(6)], axis=1
            )
            for v in self.values
        ]
        return upward[:, None] * found[0] + (1.0 - upward[:, None]) * found[1]


def axis_motions(
    field: ErrorField,
    volume: Volume,
    positions: Mapping[str, F64],
) -> dict[str, AxisMotions]:
    """The error motions of some axes that leave least of the field over the volume.

    Parameters
    ----------
    field
        The error.
    volume
        The working volume.
    positions
        Axes that the controller has tables for → fine positions, mm or rad.
    """
    machine = field.model.machine
    reversing = field.reversing()
    found: dict[str, AxisMotions] = {}
    for axis in positions:

        def own(where: Mapping[str, F64], facing: Mapping[str, F64], axis: str = axis) -> F64:
            motions = field.motions(where, facing)
            n = len(where[axis])
            zero = np.zeros(n)
            columns = [motions.get(ErrorMotion(axis, c), zero) for c in LETTERS]
            return np.stack([np.broadcast_to(c, (n,)) for c in columns], axis=1)

        mean = marginal(
            own, machine, volume, axis, positions[axis], reverses=axis in reversing
        ).mean
        found[axis] = AxisMotions(axis, positions[axis], mean)
    return _with_the_rest(field, volume, found)


def _with_the_rest(
    field: ErrorField, volume: Volume, found: dict[str, AxisMotions]
) -> dict[str, AxisMotions]:
    """What the error motions leave of the field, spread over them."""
    machine = field.model.machine
    where = volume.spread(machine.structure.axes, _POINTS)
    unknown = np.full(len(next(iter(where.values()))), 0.5)
    own = {axis: m.at(where[axis], unknown) for axis, m in found.items()}
    left = field(where) - _moved(field, where, own)
    shift = left.mean(axis=0)
    found = _shifted(found, shift)
    left = left - shift
    if np.abs(left).max() <= _NOTHING:
        return found
    columns, layout = _columns(field, volume, where, tuple(found))
    coefficients = _smallest_solution(columns, left.reshape(-1))
    spread = dict(found)
    for axis, k, nodes, scale, first in layout:
        values = coefficients[first : first + len(nodes)] * scale
        change = interpolate((nodes,), values, (found[axis].positions,))
        added = spread[axis].values.copy()
        added[:, :, k] += change
        spread[axis] = replace(spread[axis], values=added)
    return spread


def _smallest_solution(columns: F64, wanted: F64) -> F64:
    """Least squares; of the many solutions that levers leave, the one that changes tables least."""
    values, vectors = np.linalg.eigh(columns.T @ columns)
    sound = values > _RCOND * values[-1]
    part = vectors[:, sound]
    return np.asarray(part @ ((part.T @ (columns.T @ wanted)) / values[sound]))


def _moved(field: ErrorField, where: Mapping[str, F64], own: Mapping[str, F64]) -> F64:
    """Moves of X, Y, Z by error motions, axis → (n, 6), as the model composes them: (n, 3), mm."""
    motions = {
        ErrorMotion(axis, letter): values[:, k]
        for axis, values in own.items()
        for k, letter in enumerate(LETTERS)
    }
    return field.composed(motions, field.conditions(where))


def _shifted(found: dict[str, AxisMotions], shift: F64) -> dict[str, AxisMotions]:
    """A constant shift in X, Y, Z put into the positioning of the axes along them."""
    moved = dict(found)
    for k, direction in enumerate("XYZ"):
        axis = next((a for a in moved if own_component(a) == direction), None)
        if axis is None:
            continue
        values = moved[axis].values.copy()
        values[:, :, k] += shift[k]
        moved[axis] = replace(moved[axis], values=values)
    return moved


def _columns(
    field: ErrorField, volume: Volume, where: Mapping[str, F64], axes: Sequence[str]
) -> tuple[F64, Sequence[tuple[str, int, F64, float, int]]]:
    """Moves by one unit of each coarse table's values; rotations scaled by half the volume."""
    machine = field.model.machine
    chain = Chain(machine, field.conditions(where))
    reach = max(volume.half(a) for a in machine.structure.linear)
    blocks: list[F64] = []
    layout: list[tuple[str, int, F64, float, int]] = []
    first = 0
    for axis in axes:
        nodes = np.linspace(*volume.ranges[axis], _COARSE)
        basis = hats(where[axis], nodes)
        for k, letter in enumerate(LETTERS):
            error_motion = ErrorMotion(axis, letter)
            scale = 1.0 / reach if error_motion.rotation else 1.0
            moves = chain.as_moves(chain.influence(error_motion)[0]) * scale
            blocks.append((moves[:, :, None] * basis[:, None, :]).reshape(-1, len(nodes)))
            layout.append((axis, k, nodes, scale, first))
            first += len(nodes)
    return np.concatenate(blocks, axis=1), layout
