"""A machine: its structure, its axes with their travels, and the signals it records."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.structure import Structure, is_rotary

Vec3 = tuple[float, float, float]

_DIRECTIONS: dict[str, Vec3] = {
    "X": (1.0, 0.0, 0.0),
    "Y": (0.0, 1.0, 0.0),
    "Z": (0.0, 0.0, 1.0),
}
_PARALLEL = {"U": "X", "V": "Y", "W": "Z", "R": "Z", "A": "X", "B": "Y", "C": "Z"}

ROLES = frozenset(
    [
        "scale",
        "structure",
        "spindle",
        "screw",
        "workpiece",
        "ambient",
        "coolant",
        "load",
        "speed",
        "air",
        "other",
    ]
)
"""What a recorded signal can be (formats.md); `other` for whatever is none of these."""


WHOLE_TURN = math.radians(300.0)
"""A rotary axis that turns at least so far repeats after a turn."""


@dataclass(frozen=True, slots=True)
class Axis:
    """A positioned axis, linear or rotary: travel, direction, place of its line, rotation point.

    Attributes
    ----------
    name
        ISO 841 letter: X Y Z U V W linear, A B C rotary; a digit may follow.
    travel
        Least and greatest indicated position, mm (rotary: rad).
    rotation_point
        Point about which this axis's angular errors turn, relative to the origin of its frame, mm.
        A number in a model file means that far along the axis itself; vendors differ.
    location
        Rotary axes: a point on the nominal axis average line, in machine coordinates with all axes
        at zero, mm (ISO/TR 16907, 5).
    direction
        Nominal direction of motion (rotary: of the axis of rotation) in machine axes, unit vector.
    error_acts
        Linear axes: whether the error motions act ``before`` or ``after`` the axis's own move on
        the way from workpiece to tool; before means that its own move is in its lever. None: after
        for an axis on the tool side, before for one on the workpiece side.
    """

    name: str
    travel: tuple[float, float]
    rotation_point: Vec3 = (0.0, 0.0, 0.0)
    location: Vec3 = (0.0, 0.0, 0.0)
    direction: Vec3 = field(default=(0.0, 0.0, 0.0))
    error_acts: Literal["before", "after"] | None = None

    def __post_init__(self) -> None:
        if not self.travel[0] < self.travel[1]:
            raise InputError(
                "travel must run from the lower to the higher end",
                field=f"machine.axes.{self.name}.travel",
                found=list(self.travel),
                expected="[low, high] with low < high",
            )
        if self.direction == (0.0, 0.0, 0.0):
            object.__setattr__(self, "direction", nominal_direction(self.name))
        length = float(np.linalg.norm(self.direction))
        if abs(length - 1.0) > 1e-9:
            raise InputError(
                "not a unit vector",
                field=f"machine.axes.{self.name}.direction",
                found=list(self.direction),
                expected="three components of a vector of length 1",
            )

    @property
    def rotary(self) -> bool:
        """Whether the axis turns."""
        return is_rotary(self.name)

    @property
    def middle(self) -> float:
        """The middle of the travel, mm or rad."""
        return 0.5 * (self.travel[0] + self.travel[1])

    @property
    def half_travel(self) -> float:
        """Half the length of the travel, mm or rad."""
        return 0.5 * (self.travel[1] - self.travel[0])

    def clamp(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions held at the ends of the travel, as controllers hold a table's end values."""
        return np.clip(position, *self.travel)


def nominal_direction(name: str) -> Vec3:
    """The direction that an axis's name implies (ISO 841): U ∥ X, A turns about X, …"""
    letter = name[0]
    return _DIRECTIONS[_PARALLEL.get(letter, letter)]


def own_component(name: str) -> str:
    """The component of an axis's own positioning error motion: X for E_XX, C for E_CC.

    >>> own_component("U"), own_component("C")
    ('X', 'C')
    """
    return name[0] if is_rotary(name) else _PARALLEL.get(name[0], name[0])


@dataclass(frozen=True, slots=True)
class Signal:
    """A recorded signal that effects may use, such as a temperature, a load or a feed.

    Attributes
    ----------
    name
        Column of the campaigns, and what effects call it.
    unit
        ``degC``, ``kg``, ``rpm``, … as the model file spells it.
    role
        What it is physically, one of `ROLES`.
    axis, location
        Where it sits; the same for people.
    """

    name: str
    unit: str = "degC"
    role: str = "other"
    axis: str | None = None
    location: str = ""

    @property
    def temperature(self) -> bool:
        """Whether the signal is a temperature (°C)."""
        return self.unit in ("degC", "K")


@dataclass(frozen=True)
class Machine:
    """A machine tool or CMM as ISO/TR 16907, clause 5, describes one: structure, axes, sensors.

    Attributes
    ----------
    name
        For people; may be empty.
    structure
        From workpiece to tool: ``Structure.parse("w b Y X Z t")``.
    axes
        Name → axis, for every axis of the structure.
    signals
        Name → what is recorded beside positions; may be empty.
    reference_temperature
        At which the machine is as it should be, °C (ISO 1: 20).
    serial
        Its serial number, for people and records; may be empty.

    Raises
    ------
    InputError
        When the axes and the structure code do not name the same axes, or a signal sits on an axis
        that does not exist.
    """

    name: str
    structure: Structure
    axes: Mapping[str, Axis]
    signals: Mapping[str, Signal] = field(default_factory=dict)
    reference_temperature: float = 20.0
    serial: str = ""

    def __post_init__(self) -> None:
        for axis in self.structure.axes:
            if axis not in self.axes:
                raise InputError(
                    f"axis {axis} is in the structure code but has no section",
                    field=f"machine.axes.{axis}",
                    expected=f"[machine.axes.{axis}] with its travel",
                )
        for axis in self.axes:
            if axis not in self.structure.axes:
                raise InputError(
                    f"axis {axis} is not in the structure code",
                    field=f"machine.axes.{axis}",
                    found=axis,
                    expected="one of " + ", ".join(self.structure.axes),
                )
        for signal in self.signals.values():
            if signal.role not in ROLES:
                raise InputError(
                    "unknown role",
                    field=f"machine.signals.{signal.name}.role",
                    found=signal.role,
                    expected="one of " + ", ".join(sorted(ROLES)),
                )
            if signal.axis is not None and signal.axis not in self.axes:
                raise InputError(
                    "the machine has no such axis",
                    field=f"machine.signals.{signal.name}.axis",
                    found=signal.axis,
                    expected="one of " + ", ".join(self.axes),
                )

    def own_move_in_lever(self, name: str) -> bool:
        """Whether an axis's own move is part of the lever of its angular errors."""
        stated = self.axis(name).error_acts
        if stated is not None:
            return stated == "before"
        return name in self.structure.workpiece_side

    def axis(self, name: str, field_name: str = "axis") -> Axis:
        """The axis of a given name.

        Raises
        ------
        InputError
            When the machine lacks it; the message lists the axes there are.
        """
        try:
            return self.axes[name]
        except KeyError:
            raise InputError(
                "the machine has no such axis",
                field=field_name,
                found=name,
                expected="one of " + ", ".join(self.structure.axes),
            ) from None


class OfMachine(Protocol):
    """Whatever belongs to one machine: a model."""

    @property
    def machine(self) -> Machine:
        """The machine."""


def machine_of(given: Machine | OfMachine) -> Machine:
    """The machine where a call takes a machine or a model of one.

    Raises
    ------
    TypeError
        When it is neither.
    """
    machine = given if isinstance(given, Machine) else getattr(given, "machine", None)
    if isinstance(machine, Machine):
        return machine
    raise TypeError(f"machine: found {type(given).__name__}, expected Machine or Model")
