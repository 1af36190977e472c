"""Kinematics of errors at the functional point (ISO 230-1): lever rule and exact chain.

The machine is walked from workpiece to tool as a product of nominal moves, each written at the
machine's zero position (product of exponentials): a linear axis moves along its direction by its
indicated position, a rotary axis turns about its nominal average line. An axis's error motions act
in a frame of its own:

* a tool-side axis's error acts after its own move, a workpiece-side axis's before it (unless the
  axis declares otherwise, `Axis.error_acts`: vendors differ);
* the origin is the axis's rotation point (linear) or a point of its average line (rotary);
* the components X Y Z A B C of a linear axis are those of the link that it guides, those of a
  rotary axis do not turn with the axis itself (ISO 230-7: error motions are seen from the stator).

The first-order error is ``e = Σ_a t_a + ω_a × r_a`` (lever rule, docs/conventions.md), r_a from
the frame's origin to the functional point. Everything comes out in machine axes (those of the bed).
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import (
    FUNCTIONAL_POINT,
    INSTRUMENT,
    SPINDLE,
    WORKPIECE,
    ErrorMotion,
)
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

_MOST_KEPT = 20_000
"""Rows of which the chain is kept: some 10 MB for six axes."""

_UNIT = {"X": 0, "Y": 1, "Z": 2, "A": 0, "B": 1, "C": 2}


def rotation_about(direction: F64, angle: F64) -> F64:
    """Right-handed rotations about a unit vector (Rodrigues), angles (n,) rad → (n, 3, 3)."""
    x, y, z = direction
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + s * k + (1.0 - c) * (k @ k))


def rotation_xyz(a: F64, b: F64, c: F64) -> F64:
    """``Rx(a)·Ry(b)·Rz(c)``: turns about the *current* X, Y, Z axes in this order, (n, 3, 3).

    Angles of shape (n,), rad. This is the order in which maps are applied
    (docs/conventions.md, 'exact composition').
    """
    ca, sa, cb, sb, cc, sc = np.cos(a), np.sin(a), np.cos(b), np.sin(b), np.cos(c), np.sin(c)
    rows = [
        [cb * cc, -cb * sc, sb],
        [ca * sc + sa * sb * cc, ca * cc - sa * sb * sc, -sa * cb],
        [sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb],
    ]
    return np.array(rows, dtype=np.float64).transpose(2, 0, 1)


class Chain:
    """The nominal kinematic chain of a machine, from workpiece to tool, at n rows of conditions.

    Parameters
    ----------
    machine, conditions
        The machine and where it stands.

    Attributes
    ----------
    point
        Nominal functional point in the workpiece's frame, shape (n, 3), mm: (X, Y, Z) + tool where
        no rotary axis stands away from zero.
    tool
        Tool or probe offset as the spindle's angle turns it, shape (n, 3), mm.
    """

    def __init__(self, machine: Machine, conditions: Conditions) -> None:
        self.machine = machine
        self.conditions = conditions
        n = conditions.n
        self._orientation: dict[str, F64 | None] = {}
        self._origin: dict[str, F64] = {}
        self._directions: dict[str, F64] = {}
        self._frames: dict[str, F64] = {}
        turn: F64 | None = None  # None: identity, the common case and much faster
        shift = np.zeros((n, 3))
        self._bed: F64 | None = None
        structure = machine.structure
        self._place(WORKPIECE, turn, shift)
        for name in structure.axes:
            axis = machine.axis(name)
            on_workpiece = name in structure.workpiece_side
            move = np.asarray(axis.direction)
            position = conditions.position(name)
            if name == (structure.tool_side or (None,))[0]:
                self._bed = turn
            before_turn, before_shift = turn, shift
            if axis.rotary:
                self._directions[name] = _apply(turn, move, n)
                own = rotation_about(move, position)
                line = np.asarray(axis.location)
                shift = shift + _apply(turn, line - own @ line)
                turn = own if turn is None else turn @ own
                # components are seen from the stator: the side of the bed
                frame = turn if on_workpiece else before_turn
                self._place(name, frame, before_shift + _apply(before_turn, line))
            else:
                self._directions[name] = _apply(turn, move, n)
                shift = shift + _apply(turn, move) * position[:, None]
                origin = before_shift if machine.own_move_in_lever(name) else shift
                point = np.asarray(axis.rotation_point)
                self._place(name, turn, origin + _apply(turn, point))
        if not structure.tool_side:
            self._bed = turn
        self._place(SPINDLE, turn, shift)
        self._spindle: F64 | None = None
        if structure.spindle is not None and conditions.spindle_angle is not None:
            about = np.asarray(_spindle_direction(structure.spindle))
            self._spindle = rotation_about(about, conditions.spindle_angle)
        self._hold(conditions.tool)

    @classmethod
    def of(cls, machine: Machine, conditions: Conditions) -> Chain:
        """The chain at some rows; where they are no more than `_MOST_KEPT`, made once for all."""
        if conditions.n > _MOST_KEPT:
            return cls(machine, conditions)
        where = tuple(conditions.positions.get(a) for a in machine.structure.axes)
        # what is kept holds machine and positions, so that their ids stay their own
        key = ("chain", id(machine), *map(id, where))
        return conditions.kept(key, lambda: (where, cls(machine, conditions)))[1]

    def _hold(self, tool: F64) -> None:
        """Where the functional point is with tool offsets, (n, 3)."""
        self.tool = tool if self._spindle is None else _apply(self._spindle, tool)
        self.point = self._origin[SPINDLE] + _apply(self._orientation[SPINDLE], self.tool)
        self._levers: dict[str, F64] = {}

    def with_tool(self, tool: F64) -> Chain:
        """The machine where it stands, with other tool offsets, (n, 3), mm."""
        other = copy.copy(self)
        other.conditions = replace(self.conditions, tool=tool)
        other._hold(tool)
        return other

    def _place(self, place: str, orientation: F64 | None, origin: F64) -> None:
        self._orientation[place] = orientation
        self._origin[place] = origin

    @property
    def places(self) -> tuple[str, ...]:
        """The places at which errors act, from workpiece to tool."""
        return tuple(self._origin)

    def to_machine_axes(self, vector: F64) -> F64:
        """Vectors in the workpiece's frame, shape (n, 3), as seen in machine axes."""
        return vector if self._bed is None else np.einsum("nji,nj->ni", self._bed, vector)

    def to_workpiece(self, vector: F64) -> F64:
        """Vectors in machine axes, shape (n, 3), as seen in the workpiece's frame."""
        return vector if self._bed is None else np.einsum("nij,nj->ni", self._bed, vector)

    @property
    def orientation(self) -> F64:
        """Nominal orientation of the tool in the workpiece's frame, shape (n, 3, 3)."""
        turn = self._orientation[SPINDLE]
        return np.broadcast_to(np.eye(3), (self.conditions.n, 3, 3)) if turn is None else turn

    def screw(self, axis: str) -> tuple[F64, F64]:
        """Translation and rotation of the tool per unit move of an axis, workpiece's frame.

        Returns
        -------
        translation
            Of the functional point, shape (n, 3), mm per mm (rotary: per rad).
        rotation
            Shape (n, 3), rad per rad; zeros for a linear axis.

        Raises
        ------
        InputError
            When the machine has no such axis.
        """
        direction = self._directions[self.machine.axis(axis).name]
        if not self.machine.axis(axis).rotary:
            return direction, np.zeros_like(direction)
        return crossed(direction, self.point - self._origin[axis]), direction

    def lever(self, place: str) -> F64:
        """The lever of an error motion to the functional point, (n, 3), mm, machine axes.

        Raises
        ------
        InputError
            When the machine has no such place.
        """
        self._check(place)
        if place not in self._levers:
            self._levers[place] = self.to_machine_axes(self.point - self._origin[place])
        return self._levers[place]

    def _check(self, place: str) -> None:
        if place not in self._origin:
            raise InputError(
                "the machine has no such place",
                field="axis",
                found=place,
                expected="one of " + ", ".join(self._origin),
            )

    def component(self, error_motion: ErrorMotion) -> F64:
        """Direction of an error motion's component in machine axes, shape (n, 3)."""
        unit = np.zeros(3)
        unit[_UNIT[error_motion.component]] = 1.0
        n = self.conditions.n
        if error_motion.place == FUNCTIONAL_POINT:
            return np.broadcast_to(unit, (n, 3))
        self._check(error_motion.place)
        return self.to_machine_axes(_apply(self._orientation[error_motion.place], unit, n))

    def influence(self, error_motion: ErrorMotion) -> tuple[F64, F64]:
        """Translation and rotation of the tool per unit of an error motion (the lever rule).

        Returns
        -------
        translation
            Displacement of the functional point, shape (n, 3), mm per mm or per rad, machine axes.
        rotation
            Turn of the functional orientation, shape (n, 3), rad per mm or per rad.
        """
        n = self.conditions.n
        if error_motion.place == INSTRUMENT:
            return np.zeros((n, 3)), np.zeros((n, 3))
        direction = self.component(error_motion)
        if not error_motion.rotation:
            return direction, np.zeros((n, 3))
        return crossed(direction, self.lever(error_motion.place)), direction

    def in_machine_axes(self, place: str, vector: F64) -> F64:
        """Vectors, (n, 3), given in a place's error frame, as seen in machine axes.

        Raises
        ------
        InputError
            When the machine has no such place.
        """
        if place == FUNCTIONAL_POINT:
            return vector
        self._check(place)
        return self.to_machine_axes(_apply(self._orientation[place], vector))

    def axis_moves(self) -> F64:
        """Directions of the machine's three linear axes X, Y, Z in machine axes, (n, 3, 3).

        Column k is what a positive move of the k-th linear direction does to the functional point.
        A direction that the machine has no axis for (Y of a lathe) is square to all that it has,
        and as near to the letter's own as that allows: what no axis can move.
        """
        columns = {
            letter: self.to_machine_axes(self._directions[letter])
            for letter in self.machine.structure.carrying
        }
        if len(columns) < len("XYZ"):
            columns = _with_directions_beside(columns, self.conditions.n)
        return np.stack([columns[letter] for letter in "XYZ"], axis=2)

    def along_axes(self, vectors: F64) -> F64:
        """Components of vectors in machine axes, (n, 3) or (n, 3, m), along `axis_moves`."""
        some = vectors if vectors.ndim == 3 else vectors[:, :, None]
        found = np.asarray(np.linalg.solve(self.axis_moves(), some))
        return found if vectors.ndim == 3 else found[:, :, 0]

    def as_moves(self, vectors: F64) -> F64:
        """Vectors in machine axes, (n, 3) or (n, 3, m), as moves of X, Y and Z; the same shape.

        The move of an axis that the machine does not have is 0: what stands square to all axes
        that it has is left (`left_by_moves`).
        """
        moves = self.along_axes(vectors)
        for k, letter in enumerate("XYZ"):
            if letter not in self.machine.structure.carrying:
                moves[:, k] = 0.0
        return moves

    def left_by_moves(self, vectors: F64) -> F64:
        """What no move of X, Y and Z takes away of vectors (n, 3) in machine axes, (n, 3)."""
        moved = np.einsum("nij,nj->ni", self.axis_moves(), self.as_moves(vectors))
        return np.asarray(vectors - moved)


def _with_directions_beside(columns: dict[str, F64], n: int) -> dict[str, F64]:
    """Unit directions (n, 3) for all of X, Y, Z: those that are missing square to those there."""
    missing = [letter for letter in "XYZ" if letter not in columns]
    own = np.eye(3)[[_UNIT[letter] for letter in missing]].T
    units = np.broadcast_to(own, (n, 3, len(missing)))
    if columns:
        there = np.linalg.qr(np.stack([*columns.values()], axis=2), mode="complete")[0]
        free = there[:, :, len(columns) :]
        # the free directions turned so that they are as near to the letters' own as they can be
        u, _, vt = np.linalg.svd(np.swapaxes(free, 1, 2) @ units)
        units = free @ (u @ vt)
    return columns | {letter: units[:, :, k] for k, letter in enumerate(missing)}


def first_order(chain: Chain, motions: Mapping[ErrorMotion, F64]) -> tuple[F64, F64]:
    """Error at the functional point to first order, by the lever rule: the sum of t + ω × r.

    Parameters
    ----------
    chain
        The nominal chain at n rows.
    motions
        Error motion → its value at each row, shape (n,), mm or rad.

    Returns
    -------
    translation, rotation
        Error of the functional point (n, 3), mm, and of the functional orientation (n, 3), rad;
        both actual − indicated, in machine axes.
    """
    n = chain.conditions.n
    translation, rotation = np.zeros((n, 3)), np.zeros((n, 3))
    by_place: dict[tuple[str, bool], F64] = {}
    for error_motion, value in motions.items():
        if error_motion.place != INSTRUMENT:
            own = by_place.setdefault((error_motion.place, error_motion.rotation), np.zeros((n, 3)))
            own[:, _UNIT[error_motion.component]] += value
    for (place, turns), own in by_place.items():
        vector = chain.in_machine_axes(place, own)
        if turns:
            rotation += vector
            translation += crossed(vector, chain.lever(place))
        else:
            translation += vector
    return translation, rotation


def exact(chain: Chain, motions: Mapping[ErrorMotion, F64]) -> tuple[F64, F64]:
    """Error at the functional point with full rotations, composed along the chain.

    At each place in turn, from workpiece to tool: the linear error motions are added, the rotations
    ``Rx·Ry·Rz`` join those of the places before, and the accumulated rotation acts on the nominal
    vector to the next place: ``sum += R·v − v``. Linear error motions count in nominal axes, as
    compensation maps have them, step for step; those of rotary axes, and of what a rotary axis
    carries, are turned by the rotations before them, as bodies are (`moved_along`).

    Returns
    -------
    translation
        Shape (n, 3), mm, machine axes.
    orientation
        Shape (n, 3, 3): columns are the directions of X, Y, Z at the tool, relative to nominal.
    """
    total, turned, _ = exact_steps(chain, motions)
    return total, turned


def exact_steps(
    chain: Chain, motions: Mapping[ErrorMotion, F64]
) -> tuple[F64, F64, list[tuple[str, F64]]]:
    """The exact error with the running sum after every step of the chain, each (n, 3), mm."""
    n = chain.conditions.n
    places = [p for p in chain._origin if any(c.place == p for c in motions)]
    total = np.zeros((n, 3))
    turned = np.broadcast_to(np.eye(3), (n, 3, 3))
    steps: list[tuple[str, F64]] = []
    by_place: dict[str, dict[str, F64]] = {}
    for error_motion, value in motions.items():
        if error_motion.place != INSTRUMENT:
            by_place.setdefault(error_motion.place, {})[error_motion.component] = value
    zero = np.zeros(n)
    along = moved_along(chain.machine)
    for i, place in enumerate(places):
        own = by_place[place]
        linear = np.stack([own.get(k, zero) for k in "XYZ"], axis=1)
        linear = _into_machine(chain, place, linear)
        total = total + (moved_by(turned, linear) if place in along else linear)
        steps.append((f"L of {place}", total))
        if any(k in own for k in "ABC"):
            local = rotation_xyz(*(own.get(k, zero) for k in "ABC"))
            turned = multiplied(turned, conjugated(chain, place, local))
        reach = chain.lever(place)
        if i + 1 < len(places):
            reach = reach - chain.lever(places[i + 1])
        total = total + moved_by(turned, reach) - reach
        steps.append((f"R up to {place}", total))
    if FUNCTIONAL_POINT in by_place:
        own = by_place[FUNCTIONAL_POINT]
        total = total + np.stack([own.get(k, zero) for k in "XYZ"], axis=1)
        steps.append(("at the functional point", total))
    return total, turned, steps


def moved_along(machine: Machine) -> frozenset[str]:
    """Places whose linear error motions are turned by the errors before them, composed in full.

    Rotary axes, and what one of them carries towards the tool. An arm's elbow that lies 10 mm
    elsewhere on a shoulder that stands 30 mrad elsewhere lies 0.3 mm elsewhere again. For a linear
    axis that no rotary axis carries a compensation map says otherwise: nominal axes.
    """
    structure = machine.structure
    rotary = [a for a in structure.axes if machine.axis(a).rotary]
    on_tool = [a in rotary for a in structure.tool_side]
    if True not in on_tool:
        return frozenset(rotary)
    return frozenset([*rotary, *structure.tool_side[on_tool.index(True) :], SPINDLE])


def _into_machine(chain: Chain, place: str, vector: F64) -> F64:
    orientation = chain._orientation[place]
    return chain.to_machine_axes(
        vector if orientation is None else np.einsum("nij,nj->ni", orientation, vector)
    )


def conjugated(chain: Chain, place: str, local: F64) -> F64:
    """A rotation given in a place's own axes, as seen in machine axes, (n, 3, 3)."""
    orientation, bed = chain._orientation[place], chain._bed
    if orientation is None and bed is None:
        return local
    if place not in chain._frames:
        eye = np.broadcast_to(np.eye(3), local.shape)
        frame = np.swapaxes(eye if bed is None else bed, 1, 2) @ (
            eye if orientation is None else orientation
        )
        chain._frames[place] = np.ascontiguousarray(frame.transpose(1, 2, 0)).transpose(2, 0, 1)
    frame = chain._frames[place]
    return multiplied(multiplied(frame, local), np.swapaxes(frame, 1, 2))


def multiplied(a: F64, b: F64) -> F64:
    """``a @ b`` of (n, 3, 3); written out, entry by entry, it takes a third of NumPy's time."""
    p, q = a.transpose(1, 2, 0), b.transpose(1, 2, 0)
    out = p[:, 0, None] * q[None, 0]
    out += p[:, 1, None] * q[None, 1]
    out += p[:, 2, None] * q[None, 2]
    return np.asarray(out.transpose(2, 0, 1))


def moved_by(turn: F64, vector: F64) -> F64:
    """``turn @ vector`` of (n, 3, 3) and (n, 3), for what `multiplied` made."""
    p, v = turn.transpose(1, 2, 0), vector.T
    out = p[:, 0] * v[0]
    out += p[:, 1] * v[1]
    out += p[:, 2] * v[2]
    return np.asarray(out.T)


def _apply(turn: F64 | None, vector: F64, n: int | None = None) -> F64:
    """``turn @ vector`` for vector (3,) or (n, 3); broadcast to n rows where asked."""
    if turn is None:
        return vector if n is None else np.broadcast_to(vector, (n, 3))
    if vector.ndim == 1:
        return np.asarray(turn @ vector)
    return np.asarray(np.einsum("nij,nj->ni", turn, vector))


def crossed(a: F64, b: F64) -> F64:
    """Cross products of (n, 3) and (n, 3); written out, it takes a third of NumPy's time."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    out[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    out[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return out


def _spindle_direction(spindle: str) -> tuple[float, float, float]:
    directions = {"A": (1.0, 0.0, 0.0), "B": (0.0, 1.0, 0.0), "C": (0.0, 0.0, 1.0)}
    return directions[spindle[0]]
