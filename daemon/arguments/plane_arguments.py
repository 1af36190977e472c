"""Arguments of ``abbe error-map``: a plane, where the other axes stand, temperatures, tool."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.plausible import signal_range
from abbe.compcore.model.error_map import Plane, spanning_axis
from abbe.compcore.model.model import Model
from abbe.compcore.model.required_inputs import RequiredInputs
from abbe.daemon.arguments.assignments import number
from abbe.daemon.arguments.point_arguments import Given
from abbe.daemon.arguments.ranges import ranges


def axes_of(text: str, machine: Machine) -> tuple[str, str]:
    """``"XY"`` or ``"X,Y"`` → two linear axes of the machine.

    Raises
    ------
    InputError
        For anything else.
    """
    names = text.split(",") if "," in text else list(text)
    linear = machine.structure.linear
    if len(names) != 2 or names[0] == names[1]:
        raise InputError(
            "not a plane", field="plane", found=text,
            expected="two linear axes of " + ", ".join(linear) + ": XY",
        )  # fmt: skip
    first, second = (spanning_axis(machine, name).name for name in names)
    return first, second


def temperatures(text: str, machine: Machine) -> list[float]:
    """``"20,19"`` → temperatures, °C; raises as `number`."""
    thermometers = [s for s in machine.signals.values() if s.unit == "degC"]
    if not thermometers:
        raise InputError(
            "no thermometer that could have a temperature", field="temperature", found=text
        )
    allowed = signal_range(thermometers[0])
    return [number("temperature", part, "°C", allowed) for part in text.split(",")]


def planes(
    model: Model,
    across: tuple[str, str],
    arguments: Sequence[str],
    limits: Sequence[str],
    points: int,
    temperature: Sequence[float],
) -> tuple[list[Plane], Given]:
    """The plane, once for each temperature that all thermometers have which are not given.

    Raises
    ------
    InputError
        For what means nothing on this machine, an axis of the plane that is given a position, and
        what the model needs and is not given.
    """
    machine = model.machine
    given = Given.parse(arguments, machine)
    for name in across:
        if name in given.positions:
            raise InputError(
                "this axis spans the plane", field=name, found=f"{name}=…",
                expected=f"--range {name}=LOW,HIGH, or another --plane",
            )  # fmt: skip
    wanted = ranges(limits, machine, "range")
    for name in wanted:
        if name not in across:
            raise InputError(
                "not an axis of the plane", field="range", found=name,
                expected="one of " + ", ".join(across),
            )  # fmt: skip
    first, second = (wanted.get(a, machine.axes[a].travel) for a in across)
    others = [a for a in machine.structure.axes if a not in across]
    base = Plane(
        across,
        (first, second),
        (points, points),
        {a: given.positions.get(a, machine.axes[a].middle) for a in others},
        {},
        given.directions,
        given.tool or (0.0, 0.0, 0.0),
        given.time or 0.0,
        given.spindle_angle,
    )
    required = RequiredInputs.of(model)
    needed = set(required.signals)
    made = []
    for warmth in temperature or (None,):
        thermal = {
            s.name: warmth
            for s in machine.signals.values()
            if warmth is not None and s.unit == "degC" and s.name in needed
        }
        signals = {**thermal, **given.signals}
        given.require(model, required, signals, clock=given.time is not None)
        made.append(replace(base, signals={s: signals[s] for s in machine.signals if s in signals}))
    return made, given
