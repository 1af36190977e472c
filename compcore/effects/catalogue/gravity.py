"""Gravity on parts that a rotary axis carries: they sag, and what bears them leans."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects.base import (
    F64,
    AxisLetter,
    Component,
    Effect,
    ErrorMotion,
    Motion,
    Parameter,
)
from abbe.compcore.effects.catalogue.rotary.spindle import spindle_direction
from abbe.compcore.effects.registry import register
from abbe.compcore.effects.targets import ROTATIONS, TRANSLATIONS, require_rotary
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain, rotation_about
from abbe.compcore.machine.machine import Axis, Machine

_DOWN = np.array([0.0, 0.0, -1.0])
_JOINTS = 3
_NO_LINK = 1e-3
"""mm: parallel lines that are nearer are one."""
_LEVEL = 0.1
"""rad that a column may stand askew."""


def _fit_or_none(value: object) -> object:
    return None if value in (None, "", "down") else value


Gravity = Annotated[Literal["fit"] | None, BeforeValidator(_fit_or_none)]


@register
class GravityFlexure(Effect):
    """A part that a rotary axis carries, and that sags under its own weight as the axis tilts it.

    A swivel head, a trunnion's table, a telescope's tube: upright it stands under its weight
    without leaning, lying it hangs. The axis's own angle is right, the part is not.

    Formula
        The part turns towards the ground by ``sag·sin z``, z the angle between the part and the
        vertical: a turn ``sag·(s × g)`` on the axis's own line, s the part's direction as the axis
        holds it, g gravity. The part points along ``along`` (X, Y or Z) where the axis stands at 0:
        by default as the spindle does, or Z, and across the axis; of an arm of three joints or more
        towards the next one that is parallel. With ``by`` it is the part that
        a joint further out carries, whose weight twists this axis's bearings and gear: the forearm
        (``by=B3``) turns the shoulder (``axis=B2``) of a robot, s held by that joint. A column
        (an upright ``axis=Z``) leans at its foot under what a joint that it carries holds out
        (``by=C2``): the axis's own move is in the lever, whatever ``error_acts`` says; the carriage
        of a level track leans where it stands. Gravity
        points along −Z of the machine's axes; with ``gravity = fit`` for a machine that stands
        tilted (an equatorial mount) ``s × G``, with G its three components times the sag.
    Parameters
    ----------
        sag in rad, positive towards the ground, or gx, gy, gz: within ±1 mrad, of a column ±3. A
        swivel head of 200 kg shows 10 to 50 µrad, a robot's joint 0.2 to 1 mrad, the tube of an
        amateur's telescope several, a column of 3 m under an arm 2 mrad.
    Signals
        None beyond the axes' angles.
    Typical causes
        Weight of head, table or tube on bearings, gears and brackets that give; a clamp that is
        not closed.
    Cure
        A counterweight, a clamp, a stiffer bracket; a table of the axis over its angle.
    Source
        Wallace, TPOINT (tube flexure, ``TF``: proportional to the sine of the zenith distance);
        ISO/TR 16907:2015, 7.4.2. Joints that give under the weight of all links beyond: Khalil and
        Dombre, Modeling, Identification and Control of Robots (calibration).
    """

    kind = "gravity_flexure"
    axis: str
    by: str | None = None
    along: AxisLetter | None = None
    gravity: Gravity = None

    def check(self, machine: Machine) -> None:
        """A rotary axis, or a column on the tool's side under a joint; a part that is turned."""
        super().check(machine)
        if self.by is None or self.axis not in machine.structure.tool_side:
            require_rotary(machine, self.axis, self.kind)
        if self.by is not None and self.by not in _beyond(machine, self.axis):
            raise InputError(
                "a joint that the axis carries weighs on it",
                field="by",
                found=self.by,
                expected=f"a rotary axis that {self.axis} carries",
            )
        axis = machine.axis(self._bearer)
        if np.linalg.norm(np.cross(axis.direction, self._part(machine))) < 1e-6:
            raise InputError(
                "a part along the axis itself is not tilted by it",
                field="along",
                found=self.along or "the default",
                expected="a direction across the axis",
            )

    @property
    def _bearer(self) -> str:
        """The axis that holds the part."""
        return self.axis if self.by is None else self.by

    def _part(self, machine: Machine) -> F64:
        """Where the part points while the axis that holds it stands at 0, (3,)."""
        axis = machine.axis(self._bearer)
        if self.along is not None:
            return np.asarray(np.eye(3)["XYZ".index(self.along)])
        link = _link(machine, self._bearer)
        if link is not None:
            return link
        upright = np.eye(3)["XYZ".index(spindle_direction(machine))]
        if self.axis in machine.structure.workpiece_side:
            upright = -_DOWN
        parallel = np.linalg.norm(np.cross(axis.direction, upright)) < 1e-6
        return np.array([1.0, 0.0, 0.0]) if parallel else upright

    def linear(self, machine: Machine) -> tuple[Parameter, ...]:
        """The sag; with gravity unknown three of it."""
        if self.gravity == "fit":
            return tuple(
                Parameter(f"g{k}", "rad", (-1e-3, 1e-3), f"sag towards {k.upper()}") for k in "xyz"
            )
        text = f"sag of what {self._bearer} carries, towards the ground"
        if self.by is not None:
            text = f"sag of {self.axis} under what {self.by} carries, towards the ground"
        most = 1e-3 if machine.axis(self.axis).rotary else 3e-3
        return (Parameter("sag", "rad", (-most, most), text),)

    def motions(
        self, machine: Machine, conditions: Conditions, nonlinear: Mapping[str, float]
    ) -> tuple[Motion, ...]:
        """``s × g`` on the axis's three turns; the other way round on the workpiece's side."""
        chain = Chain.of(machine, conditions)
        turns: tuple[Component, ...] = ROTATIONS
        # the directions of the axis's frame in machine axes, one row each
        frame = np.stack([chain.component(ErrorMotion(self.axis, k)) for k in turns], axis=1)
        part = self._held(machine.axis(self._bearer), machine, conditions)
        if self.by is not None:
            part = np.einsum("nij,nj->ni", frame, chain.in_machine_axes(self.by, part))
        # s × G = cross · (frame · G)
        x, y, z = part.T
        none = np.zeros(len(x))
        cross = np.stack([none, -z, y, z, none, -x, -y, x, none], axis=1).reshape(-1, 3, 3)
        turned = cross @ frame
        if self.axis in machine.structure.workpiece_side:
            turned = -turned
        columns = turned if self.gravity == "fit" else (turned @ _DOWN)[:, :, None]
        return tuple(
            Motion(ErrorMotion(self.axis, k), np.ascontiguousarray(columns[:, i]))
            for i, k in enumerate(turns)
        ) + self._at_the_foot(machine, conditions, columns)

    def _at_the_foot(
        self, machine: Machine, conditions: Conditions, columns: F64
    ) -> tuple[Motion, ...]:
        """What a lean at a column's foot moves its carriage by, where no lever says it."""
        axis = machine.axis(self.axis)
        if not _upright(axis) or machine.own_move_in_lever(self.axis):
            return ()
        risen = np.asarray(axis.direction) * conditions.position(self.axis)[:, None]
        moved = np.cross(columns, risen[:, :, None], axis=1)
        shifts: tuple[Component, ...] = TRANSLATIONS
        return tuple(
            Motion(ErrorMotion(self.axis, k), np.ascontiguousarray(moved[:, i]))
            for i, k in enumerate(shifts)
        )

    def _held(self, axis: Axis, machine: Machine, conditions: Conditions) -> F64:
        """Where the part points in the frame of the axis that holds it, its stator's, (n, 3)."""
        turn = rotation_about(np.asarray(axis.direction), conditions.position(axis.name))
        if self.axis in machine.structure.workpiece_side:
            turn = np.swapaxes(turn, 1, 2)
        return np.asarray(turn @ self._part(machine))

    def positions_used(self, machine: Machine) -> tuple[str, ...]:
        """The axis, and the rotary axes by which gravity turns in its frame."""
        column = () if machine.axis(self.axis).rotary else (self.axis,)
        return (*column, *machine.structure.rotary)

    @classmethod
    def candidates(cls, machine: Machine, coverage: Coverage) -> Iterable[GravityFlexure]:
        """Each rotary axis that moved: upright, then in a machine that stands in any way.

        Between them what weighs on the axis that carries it: the nearest joint further out, as of a
        fork head on its flange, whether or not that axis moved; and of arms all joints that are
        parallel.
        """
        moving = [a for a in machine.structure.rotary if a in coverage.moving]
        for axis in moving:
            yield cls(axis=axis)
        for axis in machine.structure.rotary:
            for number, by in enumerate(_beyond(machine, axis)):
                arms = axis in moving and _parallel(machine, axis, by)
                if by in moving and (arms or not number):
                    yield cls(axis=axis, by=by)
        for column in _columns(machine):
            for by in _beyond(machine, column):
                if by in moving:
                    yield cls(axis=column, by=by)
        for axis in moving:
            yield cls(axis=axis, gravity="fit")


def _link(machine: Machine, axis: str) -> F64 | None:
    """From a joint's line to that of the next parallel one, a unit vector; None where none is."""
    if len(machine.structure.tool_side) < _JOINTS or axis not in machine.structure.tool_side:
        return None
    own = machine.axis(axis)
    for other in _beyond(machine, axis):
        if _parallel(machine, axis, other):
            away = np.subtract(machine.axis(other).location, own.location)
            away = away - np.dot(away, own.direction) * np.asarray(own.direction)
            length = float(np.linalg.norm(away))
            if length > _NO_LINK:
                return np.asarray(away / length)
    return None


def _columns(machine: Machine) -> tuple[str, ...]:
    """The upright linear axis that carries the first joint of an arm, where there is one."""
    side = machine.structure.tool_side
    joints = [n for n, a in enumerate(side) if machine.axis(a).rotary]
    if len(joints) < _JOINTS or not joints[0]:
        return ()
    foot = side[joints[0] - 1]
    return (foot,) if _upright(machine.axis(foot)) else ()


def _upright(axis: Axis) -> bool:
    """Whether a linear axis moves along gravity."""
    return not axis.rotary and bool(np.linalg.norm(np.cross(axis.direction, _DOWN)) < _LEVEL)


def _beyond(machine: Machine, axis: str) -> tuple[str, ...]:
    """The rotary axes that an axis carries, the nearest first."""
    structure = machine.structure
    away = structure.tool_side
    if axis in structure.workpiece_side:
        away = structure.workpiece_side[::-1]
    return tuple(a for a in away[away.index(axis) + 1 :] if machine.axis(a).rotary)


def _parallel(machine: Machine, one: str, other: str) -> bool:
    first, second = (np.asarray(machine.axis(a).direction) for a in (one, other))
    return bool(np.linalg.norm(np.cross(first, second)) < 1e-3)
