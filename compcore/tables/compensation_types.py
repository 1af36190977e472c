"""The types of compensation of ISO/TR 16907:2015, 8.2: which error motions each can hold.

A property of a controller (what its tables can hold) and of a model (what it would take to hold it
in tables): error motions that depend on more than their own axis's position are beyond all types
and need a spatial grid (9.3) or live correction.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from abbe.compcore.effects.base import Effect
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import FUNCTIONAL_POINT, SPINDLE, ErrorMotion
from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.model.model import Model

Role = Literal[
    "positioning",
    "straightness",
    "squareness",
    "angular",
    "rotary positioning",
    "radial and axial",
    "tilt",
    "location",
    "beyond",
]
"""What an error motion is to its axis; ``beyond``: no type of 8.2 can hold it."""


@dataclass(frozen=True, slots=True)
class CompensationType:
    """A type of compensation of ISO/TR 16907, 8.2, such as L-POS.

    Attributes
    ----------
    name
        As in ISO/TR 16907, 8.2.
    compensates
        In words.
    holds
        Error motions that its own tables can hold as functions of their axis's position.
    contains
        Other types that it is made of.
    tool
        Whether the controller must know the tool's offset for it to be right.
    orientation
        Whether it also corrects the functional orientation, by moving rotary axes.
    """

    name: str
    compensates: str
    holds: frozenset[Role] = frozenset()
    contains: tuple[str, ...] = ()
    tool: bool = False
    orientation: bool = False


def _type(
    name: str,
    compensates: str,
    *holds: Role,
    contains: tuple[str, ...] = (),
    tool: bool = False,
    orientation: bool = False,
) -> CompensationType:
    return CompensationType(name, compensates, frozenset(holds), contains, tool, orientation)


TYPES: Mapping[str, CompensationType] = {
    t.name: t
    for t in (
        _type("L-POS", "positioning of a linear axis along one line", "positioning"),
        _type(
            "L-STR",
            "straightness of a linear axis along one line; a squareness as its slope",
            "straightness",
            "squareness",
        ),
        _type("L-SQU", "squareness of linear axes at given lines", "squareness"),
        _type(
            "L-ANG",
            "effect of a linear axis's angles on the functional point",
            "angular",
            "squareness",
            tool=True,
        ),
        _type(
            "L-VOL",
            "the functional point anywhere in the volume",
            contains=("L-POS", "L-STR", "L-SQU", "L-ANG"),
            tool=True,
        ),
        _type(
            "L-VOL+",
            "functional point and orientation anywhere in the volume",
            contains=("L-VOL", "FOR"),
            tool=True,
            orientation=True,
        ),
        _type("R-POS", "positioning of a rotary axis", "rotary positioning"),
        _type(
            "R-RAX",
            "radial and axial error motion of a rotary axis at one height or tool length",
            "radial and axial",
        ),
        _type("R-POR", "position and orientation of a rotary axis's average line", "location"),
        _type("R-ANG", "effect of a rotary axis's tilt on the functional point", "tilt", tool=True),
        _type(
            "R-VOL",
            "the functional point for any angle of the rotary axes",
            contains=("R-POS", "R-RAX", "R-POR", "R-ANG"),
            tool=True,
        ),
        _type(
            "R-VOL+",
            "functional point and orientation for any angle of the rotary axes",
            contains=("R-VOL", "FOR"),
            tool=True,
            orientation=True,
        ),
        _type("FOR", "functional orientation, by moving rotary axes", orientation=True),
        _type("L-SPEC", "of the maker's own, for linear axes"),
        _type("R-SPEC", "of the maker's own, for rotary axes"),
    )
}
"""Name → type, in the order of ISO/TR 16907, 8.2."""


@dataclass(frozen=True, slots=True)
class MotionDependence:
    """One error motion that an effect moves, and the positions and directions it depends on.

    Attributes
    ----------
    error_motion
        The error motion.
    positions, directions
        Axes on whose position, and on whose approach direction, it depends.
    varies
        Whether it changes with signals or time, so that a table holds it for stated ones only.
    tool
        Whether it depends on the tool's offset beyond the levers.
    effect
        Spec of the effect that causes it.
    """

    error_motion: ErrorMotion
    positions: tuple[str, ...] = ()
    directions: tuple[str, ...] = ()
    varies: bool = False
    tool: bool = False
    effect: str = ""

    def role(self, machine: Machine) -> Role:
        """The role of the error motion for its axis: positioning, straightness, angular, …"""
        place, component = self.error_motion.place, self.error_motion.component
        if self.tool or not {*self.positions, *self.directions} <= {place}:
            return "beyond"
        constant = not self.positions and not self.directions
        if place in (FUNCTIONAL_POINT, SPINDLE):
            return _beside_the_axes(machine, self.error_motion) if constant else "beyond"
        if place not in machine.axes:
            return "beyond"
        if machine.axis(place).rotary:
            if constant:
                return "location"
            if component == own_component(place):
                return "rotary positioning"
            return "tilt" if self.error_motion.rotation else "radial and axial"
        if self.error_motion.rotation:
            # constant, it is the same as slopes of the straightnesses of all axes behind it
            return "squareness" if constant else "angular"
        return "positioning" if component == own_component(place) else "straightness"


def _beside_the_axes(machine: Machine, error_motion: ErrorMotion) -> Role:
    """A constant at the functional point or spindle: a zero, or an angle that needs the tool."""
    head_turns = any(machine.axis(a).rotary for a in machine.structure.tool_side)
    if error_motion.place == SPINDLE and head_turns:
        return "beyond"
    if error_motion.rotation:
        return "angular"
    carried = any(own_component(a) == error_motion.component for a in machine.structure.linear)
    return "positioning" if carried else "beyond"


def on_machine(names: Iterable[str], machine: Machine) -> tuple[str, ...]:
    """The types of compensation possible on a machine: without two rotary axes no orientation.

    L-VOL+ and R-VOL+ move rotary axes to correct the orientation (8.2.8, 8.2.14). With fewer than
    two, what is left of them is L-VOL and R-VOL; without any, types of rotary axes hold nothing.
    """
    rotary = len(machine.structure.rotary)
    found: dict[str, None] = {}
    for name in names:
        if TYPES[name].orientation and rotary < 2:
            name = name.removesuffix("+")
            if name == "FOR":
                continue
        if rotary or not name.startswith("R-"):
            found[name] = None
    return tuple(found)


def error_motions(machine: Machine, effect: Effect) -> tuple[MotionDependence, ...]:
    """The error motions that an effect of machine or workpiece moves; none for instruments."""
    if effect.scope == "instrument":
        return ()
    axes = machine.structure.axes
    at = Conditions.at(
        {a: machine.axis(a).middle for a in axes},
        signals=dict.fromkeys(machine.signals, machine.reference_temperature),
    )
    nonlinear = {p.name: p.starts[0] for p in effect.nonlinear(machine)}
    error_motions = dict.fromkeys(m.error_motion for m in effect.motions(machine, at, nonlinear))
    varies = bool(effect.signals_needed()) or _changes_with_time(machine, effect, nonlinear)
    return tuple(
        MotionDependence(
            error_motion,
            effect.positions_used(machine),
            effect.directions_used(),
            varies,
            effect.reads_tool,
            effect.spec,
        )
        for error_motion in error_motions
    )


def _changes_with_time(machine: Machine, effect: Effect, nonlinear: Mapping[str, float]) -> bool:
    at = Conditions.at(
        {a: machine.axis(a).middle for a in machine.structure.axes},
        time=np.array([0.0, 1e2, 1e4, 1e6]),
        signals=dict.fromkeys(machine.signals, machine.reference_temperature),
    )
    return any(
        bool(np.ptp(m.columns, axis=0).any()) for m in effect.motions(machine, at, nonlinear)
    )


@dataclass(frozen=True)
class TypesNeeded:
    """The types of compensation that a model's effects need, and what is beyond all types.

    Attributes
    ----------
    types
        Names, in the order of ISO/TR 16907, 8.2; the fewest that hold all that can be held.
    by_type
        Elementary type → the error motions that it holds.
    beyond
        Error motions that no type holds.
    """

    types: tuple[str, ...]
    by_type: Mapping[str, tuple[MotionDependence, ...]]
    beyond: tuple[MotionDependence, ...]


_ELEMENTARY: Mapping[Role, str] = {
    "positioning": "L-POS",
    "straightness": "L-STR",
    "squareness": "L-SQU",
    "angular": "L-ANG",
    "rotary positioning": "R-POS",
    "radial and axial": "R-RAX",
    "location": "R-POR",
    "tilt": "R-ANG",
}


def types_needed(model: Model) -> TypesNeeded:
    """The types of compensation that would hold a model's effects, fitted or not."""
    machine = model.machine
    by_type: dict[str, list[MotionDependence]] = {}
    beyond: list[MotionDependence] = []
    for effect in model.effects:
        for motion in error_motions(machine, effect):
            role = motion.role(machine)
            if role == "beyond":
                beyond.append(motion)
            else:
                by_type.setdefault(_ELEMENTARY[role], []).append(motion)
    names = set(by_type)
    for whole in ("L-VOL", "R-VOL"):
        parts = set(TYPES[whole].contains)
        if parts <= names:
            names = names - parts | {whole}
    ordered = tuple(name for name in TYPES if name in names)
    return TypesNeeded(ordered, {k: tuple(v) for k, v in by_type.items()}, tuple(beyond))
