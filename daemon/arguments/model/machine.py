"""A machine on the command line: structure, travels, places of rotary axes, sensors."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace

from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_csv.columns import AXIS, RESERVED
from abbe.compcore.machine.common_machines import COMMON_MACHINES, CommonMachine, common_machine
from abbe.compcore.machine.machine import ROLES, Axis, Machine, Signal, Vec3
from abbe.compcore.machine.plausible import (
    POINT,
    SHORTEST_TRAVEL,
    TRAVEL,
    TRAVEL_ROTARY,
    usual_unit,
)
from abbe.compcore.machine.structure import Structure, is_rotary
from abbe.daemon.arguments.assignments import number

_UNITS = {"speed": "rpm", "load": "kg"}
"""Role → unit of a signal where none is given; else °C."""
_THERMOMETERS = ("scale", "screw", "workpiece")
_APART = frozenset(',";')
"""Characters that part the columns of a campaign."""
_SENSOR = "NAME=ROLE[,AXIS[,UNIT]], such as T_x=scale,X or n=speed,,rpm"


def structure_of(text: str) -> tuple[Structure, CommonMachine | None]:
    """A structure code, or a common machine's name; and which common machine that is, if any.

    Raises
    ------
    InputError
        Naming the offending piece of the code.
    """
    kind = COMMON_MACHINES.get(text.strip()) or common_machine(text)
    try:
        return Structure.parse(text if kind is None else kind.structure), kind
    except InputError as error:
        names = ", ".join(COMMON_MACHINES)
        raise InputError(
            error.problem,
            field="structure",
            found=error.found,
            expected=f"{error.expected}, or one of {names}",
        ) from None


def travel_of(axis: str, text: str) -> tuple[float, float]:
    """``0,700`` → (0.0, 700.0), mm; rotary axes degrees → rad.

    Raises
    ------
    InputError
        For what is no two numbers, not rising, or not believable.
    """
    field = f"travel {axis}"
    allowed = TRAVEL_ROTARY if is_rotary(axis) else TRAVEL
    parts = _parts(text)
    if len(parts) != 2:
        raise InputError(
            "not two ends", field=field, found=text, expected=f"LOW,HIGH in {allowed.unit}"
        )
    low, high = (number(field, part, allowed.unit, allowed) for part in parts)
    if not high - low >= SHORTEST_TRAVEL:
        raise InputError(
            "travel must run from the lower to the higher end",
            field=field,
            found=text,
            expected="LOW,HIGH with LOW < HIGH",
        )
    scale = math.pi / 180.0 if is_rotary(axis) else 1.0
    return low * scale, high * scale


def location_of(axis: str, text: str) -> Vec3:
    """A point of a rotary axis's line, mm: ``250,200,0``; raises `InputError`."""
    field = f"location {axis}"
    if not is_rotary(axis):
        raise InputError("only a rotary axis has a line", field=field, expected="an axis A, B or C")
    parts = _parts(text)
    if len(parts) != 3:
        raise InputError("not three numbers", field=field, found=text, expected="x,y,z in mm")
    x, y, z = (number(field, part, "mm", POINT) for part in parts)
    return x, y, z


def sensor_of(name: str, text: str) -> Signal:
    """A signal from ``ROLE[,AXIS[,UNIT]]``.

    Raises
    ------
    InputError
        For a name that a campaign's columns have for something else or cannot have, an unknown
        role, a unit that does not go with it.
    """
    field = f"sensor {name}"
    if name in RESERVED or AXIS.fullmatch(name.removesuffix("_dir")):
        raise InputError(
            "a campaign has this column for something else",
            field="sensor",
            found=name,
            expected="a name such as T_x",
        )
    if not name.isprintable() or name != name.strip() or set(name) & _APART or name[:1] == "#":
        raise InputError(
            "no column of a campaign can be called so",
            field="sensor",
            found=name,
            expected="a name such as T_x, without comma or quotation mark",
        )
    role, axis, unit = (*(part.strip() for part in text.split(",", 2)), "", "")[:3]
    if role not in ROLES:
        raise InputError(
            "unknown role",
            field=field,
            found=role,
            expected=f"one of {', '.join(sorted(ROLES))}; {_SENSOR}",
        )
    signal = Signal(name, unit or _UNITS.get(role, "degC"), role, axis or None)
    signal = replace(signal, unit=usual_unit(signal))
    if role in _THERMOMETERS and not signal.temperature:
        raise InputError(
            f"a sensor of role {role} is a thermometer", field=field, found=unit, expected="degC"
        )
    if role in _UNITS and signal.temperature:
        raise InputError(
            f"a sensor of role {role} is no thermometer",
            field=field,
            found=unit,
            expected=f"a unit such as {_UNITS[role]}",
        )
    return signal


def two_drives_of(texts: Iterable[str]) -> list[dict[str, str]]:
    """Keys of the effect `two_drives` from ``AXIS=SIGNAL,ACROSS,MASTER,SLAVE``.

    Raises
    ------
    InputError
        For a text of another form.
    """
    found = []
    for text in texts:
        axis, equals, rest = text.partition("=")
        parts = [p.strip() for p in rest.split(",")]
        if not equals or len(parts) != 4 or not all([axis.strip(), *parts]):
            raise InputError(
                "not two drives", field="two-drives", found=text,
                expected="AXIS=SIGNAL,ACROSS,MASTER,SLAVE, such as Y=Y_ahead,X,-50,1250",
            )  # fmt: skip
        signal, across, master, slave = parts
        found.append({"axis": axis.strip(), "signal": signal, "across": across, "master": master,
                      "slave": slave})  # fmt: skip
    return found


def machine_of(
    structure: Structure,
    name: str,
    travels: Mapping[str, str],
    locations: Mapping[str, str],
    sensors: Iterable[Signal],
) -> Machine:
    """A machine from what was typed.

    Raises
    ------
    InputError
        For a name that is no text, an axis without travel, a travel without axis, a sensor at an
        axis that is not there.
    """
    if any("\ud800" <= letter <= "\udfff" for letter in name):
        raise InputError("not UTF-8", field="name", found=name, expected="the machine's name")
    for axis in (*travels, *locations):
        if axis not in structure.axes:
            raise InputError(
                "the structure has no such axis",
                found=axis,
                expected="one of " + ", ".join(structure.axes),
            )
    missing = [axis for axis in structure.axes if axis not in travels]
    if missing:
        raise InputError(
            "how far does it travel?",
            field="travel " + ", ".join(missing),
            expected=" ".join(f"--travel {axis}=LOW,HIGH" for axis in missing),
        )
    axes = {
        axis: Axis(
            axis,
            travel_of(axis, travels[axis]),
            location=location_of(axis, locations[axis]) if axis in locations else (0.0, 0.0, 0.0),
        )
        for axis in structure.axes
    }
    return Machine(name, structure, axes, {signal.name: signal for signal in sensors})


def _parts(text: str) -> list[str]:
    return [part for part in re.split(r"[,\s]+", text.strip("[] \t")) if part]
