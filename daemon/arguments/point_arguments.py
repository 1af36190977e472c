"""KEY=VALUE arguments of ``abbe correct`` → conditions, and what is missing or doubtful."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.plausible import (
    SPINDLE_ANGLE,
    TIME,
    perhaps_fahrenheit,
    position_range,
    signal_range,
)
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model
from abbe.compcore.model.required_inputs import RequiredInputs, validity
from abbe.daemon.arguments.assignments import number, split_assignments, tool_offset
from abbe.daemon.arguments.effect_name import short

_BESIDE = 0.5
"""Part of a signal's measured range by which it may be beside it without a word."""


@dataclass(frozen=True)
class Given:
    """The conditions of a command line, in the units inside the code; signals in their own.

    Attributes
    ----------
    positions, directions, signals
        By axis or signal name.
    tool, time, spindle_angle
        None where not given.
    """

    positions: Mapping[str, float] = field(default_factory=dict)
    directions: Mapping[str, float] = field(default_factory=dict)
    signals: Mapping[str, float] = field(default_factory=dict)
    tool: tuple[float, float, float] | None = None
    time: float | None = None
    spindle_angle: float | None = None

    @classmethod
    def parse(cls, arguments: Iterable[str], machine: Machine) -> Given:
        """Read KEY=VALUE arguments.

        Raises
        ------
        InputError
            For a key that means nothing on this machine, or a value that is no number.
        """
        positions: dict[str, float] = {}
        directions: dict[str, float] = {}
        signals: dict[str, float] = {}
        tool: tuple[float, float, float] | None = None
        time: float | None = None
        spindle: float | None = None
        turning = machine.structure.spindle
        for key, text in split_assignments(arguments).items():
            axis = key.removesuffix("_dir")
            if key in machine.axes:
                rotary = is_rotary(key)
                allowed = position_range(machine.axes[key])
                value = number(key, text, "degrees" if rotary else "mm", allowed)
                positions[key] = math.radians(value) if rotary else value
            elif axis != key and axis in machine.axes:
                directions[axis] = number(key, text, "1, -1 or 0")
                if directions[axis] not in (-1.0, 0.0, 1.0):
                    raise InputError(
                        "not a direction", field=key, found=text, expected="1, -1 or 0 (unknown)"
                    )
            elif key == "tool":
                tool = tool_offset(key, text)
            elif key == "time":
                time = number(key, text, "s", TIME)
            elif turning is not None and key in (turning, f"({turning})"):
                spindle = math.radians(number(key, text, "degrees", SPINDLE_ANGLE))
            elif key in machine.signals:
                signal = machine.signals[key]
                signals[key] = number(key, text, signal.unit, signal_range(signal))
            else:
                raise InputError(
                    "the model knows no such axis or signal",
                    field=key,
                    found=f"{key}={text}",
                    expected="one of " + ", ".join(_keys(machine)),
                )
        return cls(positions, directions, signals, tool, time, spindle)

    def conditions(self, model: Model) -> Conditions:
        """One row of conditions.

        Raises
        ------
        InputError
            When an axis, a signal or the time that the model needs was not given; says what to add.
        """
        missing = [a for a in model.machine.structure.axes if a not in self.positions]
        if missing:
            raise InputError(
                "no position given for " + ", ".join(missing),
                expected=" ".join(
                    f"{a}=.. ({'degrees' if is_rotary(a) else 'mm'})" for a in missing
                ),
            )
        required = RequiredInputs.of(model)
        self.require(model, required, have=self.signals, clock=self.time is not None)
        at = Conditions.at(
            self.positions,
            tool=self.tool or (0.0, 0.0, 0.0),
            directions=self.directions,
            time=self.time or 0.0,
            signals=self.signals,
        )
        if self.spindle_angle is None:
            return at
        return replace(at, spindle_angle=np.array([self.spindle_angle]))

    @staticmethod
    def require(
        model: Model, required: RequiredInputs, have: Iterable[str], *, clock: bool
    ) -> None:
        """Refuse when a signal, or the time, that the model reads is not there.

        Raises
        ------
        InputError
            Naming all that is missing and the effects that read it.
        """
        known = set(have)
        missing = [s for s in required.signals if s not in known]
        if missing:
            readers = [
                short(t.effect.spec)
                for t in model.terms
                if t.fitted and set(t.effect.signals_needed()) & set(missing)
            ]
            raise InputError(
                f"the model needs {', '.join(missing)}, not given ({'; '.join(readers)})",
                expected=" ".join(f"{s}=..{_unit(model.machine, s)}" for s in missing),
            )
        if required.clock and not clock:
            raise InputError(
                "the model needs the time: it has effects that grow or fade with it",
                expected="time=.. (s since the start that the model was fitted with)",
            )


def doubts(model: Model, given: Given) -> list[str]:
    """Warnings about one point, in words."""
    found = beyond(model, {a: (q, q) for a, q in given.positions.items()})
    for name, value in given.signals.items():
        signal = model.machine.signals.get(name)
        if signal is not None and signal.unit == "degC":
            found += perhaps_fahrenheit(name, value, signal.role)
        found += _unmeasured(model, name, value)
    required = RequiredInputs.of(model)
    for axis in required.directions:
        if given.directions.get(axis, 0.0) == 0.0:
            found.append(
                f"{axis}'s approach direction is not given ({axis}_dir=1 or -1): "
                "halfway between both is taken"
            )
    if required.lagged:
        slow = ", ".join(required.lagged)
        found.append(f"{slow}: taken as steady for long (the model follows them slowly)")
    return found + unfitted(model)


def _unmeasured(model: Model, name: str, value: float) -> list[str]:
    """A warning about a signal far from where it was while the model was measured."""
    if name not in model.measured_signals:
        return []
    low, high = model.measured_signals[name]
    if low - _BESIDE * (high - low) <= value <= high + _BESIDE * (high - low):
        return []
    unit = model.machine.signals[name].unit if name in model.machine.signals else ""
    return [f"{name}={value:g} {unit} is outside {low:g} … {high:g} {unit}, where it was measured"]


def unfitted(model: Model) -> list[str]:
    """A warning about effects without values."""
    names = [short(t.effect.spec) for t in model.terms if not t.fitted]
    if not names:
        return []
    return [f"not fitted yet, predicts 0: {'; '.join(names)}"]


def beyond(model: Model, ranges: Mapping[str, tuple[float, float]]) -> list[str]:
    """Warnings about positions (least and greatest, mm or rad) where end values are held."""
    found = []
    for axis, (low, high) in validity(model).items():
        least, greatest = ranges.get(axis, (low, high))
        if least >= low and greatest <= high:
            continue
        scale, unit = (math.degrees(1.0), "°") if is_rotary(axis) else (1.0, " mm")
        where = least if least < low else greatest
        found.append(
            f"{axis}={where * scale:g}{unit} is outside {low * scale:g} … {high * scale:g}{unit}, "
            "the travel or a table's range: values at the end are held"
        )
    return found


def _keys(machine: Machine) -> list[str]:
    axes = list(machine.structure.axes)
    spindle = machine.structure.spindle
    turning = [spindle if spindle not in axes else f"({spindle})"] if spindle else []
    return [*axes, "tool", *machine.signals, *turning, *(f"{a}_dir" for a in axes), "time"]


def _unit(machine: Machine, signal: str) -> str:
    return f" ({machine.signals[signal].unit})"


def held_axes(text: str, machine: Machine) -> frozenset[str]:
    """``"B,C"`` or ``"all"`` → rotary axes that a command does not move.

    Raises
    ------
    InputError
        For an axis that the machine lacks or that is linear.
    """
    rotary = machine.structure.rotary
    if text == "all":
        return frozenset(rotary)
    names = frozenset(name.strip() for name in text.split(",") if name.strip())
    for name in sorted(names - set(rotary)):
        raise InputError(
            "not a rotary axis of the machine", field="hold", found=name,
            expected="one of " + (", ".join(rotary) or "none on this machine"),
        )  # fmt: skip
    return names
