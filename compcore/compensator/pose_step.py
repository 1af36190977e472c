"""The live step where rotary axes are corrected too: where the machine really stands, as a pose.

Errors turn the tool as well as move it. Corrected positions of all axes together are those at which
the *nominal* machine would have the pose that the real one has: its point in any case, its
direction as far as the rotary axes can. A controller that takes them for its own and drives them
to the target brings the tool to the target's pose. It is `abbe.compcore.model.pose` read backwards,
with the same damping near a kinematic pole and the same bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.compensator.folding.tables import FoldedTables
from abbe.compcore.compensator.rotation import (
    IDENTITY,
    Nine,
    Triple,
    about,
    apply,
    product,
    solved,
)
from abbe.compcore.compensator.step_general import chain_error, motions_at, stages_of, walk
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Composition
from abbe.compcore.model.pose import DAMPING, MOST_TURN, POLE, spinning_axes, tool_letter

_ROUNDS = 8
_AT_PLACE = 1e-8
"""mm: a round that moves less than this is the last."""
_LEFT = 1e-9
"""rad: less than this counts as nothing left."""


class PoseError(NamedTuple):
    """The error of a pose, as moves of the axes that would cause it.

    Attributes
    ----------
    moves
        Of X, Y, Z (mm), then of the rotary axes that are corrected (rad).
    direction_left, spin_left
        Angle between the tool and where it points by the corrected positions, and its turn about
        itself, rad. The second does not matter where a spindle turns the tool.
    damped
        Whether something is left because a rotary axis stands near a pole.
    limited
        Whether a rotary axis would have to turn by more than `abbe.compcore.model.pose.MOST_TURN`.
    """

    moves: tuple[float, ...]
    direction_left: float
    spin_left: float
    damped: bool
    limited: bool


PoseStep = Callable[[Sequence[float], Sequence[float]], PoseError]


def pose_step(
    machine: Machine,
    composition: Composition,
    tables: FoldedTables,
    state: SlowState,
    turning: Sequence[str],
) -> PoseStep:
    """The step of a machine some of whose rotary axes are corrected.

    Parameters
    ----------
    machine, composition, tables, state
        As for `abbe.compcore.compensator.step_general.general_step`.
    turning
        Rotary axes that are corrected; the others stay where they are.

    Returns
    -------
    Positions and directions in the order of the structure's axes → `PoseError`.
    """
    axes = machine.structure.axes
    zero = {a: np.zeros(1) for a in axes}
    tool: Triple = tuple(Chain(machine, state.conditions(zero, {})).tool[0].tolist())
    itself: Triple = _UNITS[tool_letter(machine)]
    motions, error = motions_at(tables), chain_error(tables, composition)
    stages = stages_of(machine, tables.error_motions)
    spins = spinning_axes(machine, "XYZ".index(tool_letter(machine)))
    linear = [axes.index(a) for a in "XYZ"]
    turned = [axes.index(a) for a in turning]
    pointing = [k for k, a in enumerate(turning) if a not in spins]
    spinning = next((k for k, a in enumerate(turning) if a in spins), None)
    nominal = _Nominal(machine, tool, itself, linear, turned)

    def step(positions: Sequence[float], directions: Sequence[float]) -> PoseError:
        visits, turn, sx, sy, sz, bed, _ = walk(stages, positions)
        gx, gy, gz = tool if turn is IDENTITY else apply(turn, *tool)
        at = (sx + gx, sy + gy, sz + gz)
        ex, ey, ez, error_turn = error(visits, motions(positions, directions), *at, bed)
        point = (at[0] + ex, at[1] + ey, at[2] + ez)
        orientation = error_turn if turn is IDENTITY else product(error_turn, turn)
        direction = _unit(apply(orientation, *itself))
        here = nominal.at(positions)
        columns = [_square_to(here.turns[k][1], direction) for k in pointing]
        turns_for, least_sine = _solver(columns)
        found, moved, limited = here, list(positions), False
        amounts = [0.0] * len(turned)
        for _ in range(_ROUNDS):
            need = _cross(found.direction, direction)
            for column, k in zip(columns, pointing, strict=True):
                need = _plus(need, column, amounts[k])
            wanted = dict(zip(pointing, turns_for(need), strict=True))
            if spinning is not None:
                along = _dot(found.turns[spinning][1], direction)
                spin = _spin(found.orientation, orientation, direction)
                wanted[spinning] = amounts[spinning] + spin / along
            limited = False
            shift = _minus(point, found.point)
            for k, amount in wanted.items():
                held = min(max(amount, -MOST_TURN), MOST_TURN)
                limited = limited or abs(held - amount) > _LEFT
                shift = _plus(shift, found.turns[k][0], amounts[k] - held)
                amounts[k] = held
                moved[turned[k]] = positions[turned[k]] + held
            way = solved(found.moves, *shift)
            for i, step_ in zip(linear, way, strict=True):
                moved[i] += step_
            found = nominal.at(moved)
            if abs(way[0]) + abs(way[1]) + abs(way[2]) < _AT_PLACE:
                break
        left = _cross(found.direction, direction)
        direction_left = math.sqrt(_dot(left, left))
        spin_left = abs(_spin(found.orientation, orientation, direction))
        damped = direction_left > _LEFT and least_sine < POLE
        moves = *(moved[i] - positions[i] for i in linear), *amounts
        return PoseError(moves, direction_left, spin_left, damped, limited)

    return step


class _Pose(NamedTuple):
    """The nominal pose at some positions, and what unit moves of the axes do to it."""

    point: Triple
    direction: Triple
    orientation: Nine
    moves: Sequence[Triple]
    """Of X, Y, Z: mm per mm."""
    turns: Sequence[tuple[Triple, Triple]]
    """Of the rotary axes: move of the point, mm per rad, and the axis itself."""


class _Nominal:
    """The nominal machine, seen from the workpiece."""

    def __init__(
        self,
        machine: Machine,
        tool: Triple,
        itself: Triple,
        linear: Sequence[int],
        turned: Sequence[int],
    ) -> None:
        self._tool, self._itself = tool, itself
        self._linear, self._turned = tuple(linear), tuple(turned)
        axes = [machine.axis(a) for a in machine.structure.axes]
        self._axes = [(a.rotary, a.direction, a.location) for a in axes]

    def at(self, positions: Sequence[float]) -> _Pose:
        """The pose at positions of all axes."""
        turn = IDENTITY
        sx = sy = sz = 0.0
        screws: list[tuple[Triple, Triple]] = []
        for q, (rotary, direction, location) in zip(positions, self._axes, strict=True):
            axis = direction if turn is IDENTITY else apply(turn, *direction)
            if rotary:
                lx, ly, lz = location if turn is IDENTITY else apply(turn, *location)
                cx, cy, cz = sx + lx, sy + ly, sz + lz
                turn = product(turn, about(direction, q))
                lx, ly, lz = apply(turn, *location)
                sx, sy, sz = cx - lx, cy - ly, cz - lz
                screws.append((axis, (cx, cy, cz)))
            else:
                sx, sy, sz = sx + axis[0] * q, sy + axis[1] * q, sz + axis[2] * q
                screws.append((axis, _ORIGIN))
        gx, gy, gz = apply(turn, *self._tool)
        point = (sx + gx, sy + gy, sz + gz)
        turns = [
            (_cross(screws[i][0], _minus(point, screws[i][1])), screws[i][0]) for i in self._turned
        ]
        moves = [screws[i][0] for i in self._linear]
        return _Pose(point, apply(turn, *self._itself), turn, moves, turns)


_ORIGIN: Triple = (0.0, 0.0, 0.0)
_UNITS: dict[str, Triple] = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


def _solver(columns: Sequence[Triple]) -> tuple[Callable[[Triple], list[float]], float]:
    """How far axes turn for a turn that is needed: least squares, damped near a pole.

    Parameters
    ----------
    columns
        What a unit turn of each axis does to the tool's direction.

    Returns
    -------
    The turn that is needed → the axes', and the least sine between an axis that is needed and the
    tool; 1 where there is none.
    """
    if not columns:
        return lambda _: [], 1.0
    if len(columns) == 1:
        (column,) = columns
        square = _dot(column, column)
        share = 1.0 / (square + _damping(square))
        return lambda need: [share * _dot(column, need)], math.sqrt(square)
    u, sines, vt = np.linalg.svd(np.array(columns).T, full_matrices=False)
    damping = np.array([_damping(sine * sine) for sine in sines.tolist()])
    inverse = (vt.T * (sines / (sines**2 + damping + 1e-300))) @ u.T
    return lambda need: [float(x) for x in inverse @ np.array(need)], float(sines[:2].min())


def _damping(square: float) -> float:
    """Square of the damping of an axis, by the square of its sine to the tool."""
    return (DAMPING * max(0.0, 1.0 - square / POLE**2)) ** 2


def _spin(now: Nine, wanted: Nine, direction: Triple) -> float:
    """By what an orientation has to be turned about the tool to be the wanted one, rad."""
    turn = _ORIGIN
    for k in range(3):
        turn = _plus(turn, _cross((now[k], now[k + 3], now[k + 6]), wanted[k::3]), 0.5)
    return _dot(turn, direction)


def _square_to(vector: Triple, direction: Triple) -> Triple:
    return _plus(vector, direction, -_dot(vector, direction))


def _plus(a: Triple, b: Triple, times: float) -> Triple:
    return a[0] + times * b[0], a[1] + times * b[1], a[2] + times * b[2]


def _minus(a: Triple, b: Triple) -> Triple:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _dot(a: Triple, b: Triple) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Triple, b: Sequence[float]) -> Triple:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _unit(a: Triple) -> Triple:
    length = math.sqrt(_dot(a, a))
    return a[0] / length, a[1] / length, a[2] / length
