"""A machine asked for on a terminal, question by question; every answer is checked at once.

Questions go to standard error, so that an answer in JSON stays alone on standard output.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeVar

import typer

from abbe.compcore.errors import InputError
from abbe.compcore.machine.common_machines import COMMON_MACHINES, CommonMachine, usual_travel
from abbe.compcore.machine.machine import Machine, Signal
from abbe.compcore.machine.structure import Structure, is_rotary
from abbe.compcore.model.start_model import StartOptions
from abbe.daemon.arguments.model.machine import (
    location_of,
    machine_of,
    sensor_of,
    structure_of,
    travel_of,
)

Answer = TypeVar("Answer")
_NONE = "none"
_PLACES = (
    ("spindle", "Thermometer at the spindle's bearings"),
    ("workpiece", "Thermometer on the workpiece"),
    ("ambient", "Thermometer in the air"),
)


def ask_machine(name: str, wanted: StartOptions) -> tuple[Machine, StartOptions]:
    """Ask for all that a start model needs.

    Parameters
    ----------
    name
        The machine's name, where it was given already.
    wanted
        What was given already; it is what Enter answers.
    """
    structure, kind = _ask_structure()
    name = name or _ask("Its name", kind.title if kind else str(structure), str)
    travels, locations = {}, {}
    _say("Travels as the controller shows them, LOW,HIGH in mm (rotary axes: degrees).")
    for axis in structure.axes:
        low, high = usual_travel(axis, kind)
        travels[axis] = _ask(f"{axis}", f"{low:g},{high:g}", partial(_typed, travel_of, axis))
        if is_rotary(axis):
            locations[axis] = _ask(
                f"{axis}: a point of its line, machine coordinates with all axes at zero, x,y,z mm",
                "0,0,0",
                partial(_typed, location_of, axis),
            )
    sensors = _ask_sensors(structure, kind)
    if wanted.bare:
        return machine_of(structure, name, travels, locations, sensors), wanted
    play = _yes("Will lines be measured in both directions (shows play)?", bool(kind and kind.play))
    wanted = replace(wanted, play=wanted.play or play)
    if structure.rotary and not wanted.rotary_motions:
        question = "Will rotary axes' own motions be measured (R-test, autocollimator)?"
        wanted = replace(wanted, rotary_motions=_yes(question, False))
    if structure.spindle and not structure.spindle_on_workpiece and not wanted.tool_lengths:
        question = "Will tools of different lengths be used while measuring?"
        wanted = replace(wanted, tool_lengths=_yes(question, False))
    return machine_of(structure, name, travels, locations, sensors), wanted


def _ask_structure() -> tuple[Structure, CommonMachine | None]:
    _say("What kind of machine is it?")
    names = list(COMMON_MACHINES)
    for i, name in enumerate(names, start=1):
        kind = COMMON_MACHINES[name]
        _say(f"  {i}  {kind.title:<56} {kind.structure}")
    _say("or its structure code, from workpiece w over bed b to tool t (docs/conventions.md).")

    def chosen(text: str) -> tuple[Structure, CommonMachine | None]:
        number = int(text) - 1 if text.isdecimal() else -1
        return structure_of(names[number] if 0 <= number < len(names) else text)

    return _ask("Number or code", "1", chosen)


def _ask_sensors(structure: Structure, kind: CommonMachine | None) -> list[Signal]:
    _say("Thermometers, by the names that their columns will have; several with commas between.")
    found: list[Signal] = []
    screws = kind is not None and kind.screws
    role, what = ("screw", "at the ball screw of") if screws else ("scale", "on the scale of")
    for axis in structure.linear:
        found += _ask_names(f"Thermometers {what} {axis}", f"{role},{axis}", found)
    for role, question in _PLACES:
        found += _ask_names(question, role, found)
    return found


def _ask_names(question: str, where: str, before: list[Signal]) -> list[Signal]:
    def named(text: str) -> list[Signal]:
        if text == _NONE:
            return []
        names = [name.strip() for name in text.split(",") if name.strip()]
        taken = {signal.name for signal in before}
        for i, name in enumerate(names):
            if name in taken or name in names[:i]:
                raise InputError("a name is given twice", found=name)
        return [sensor_of(name, where) for name in names]

    return _ask(question, _NONE, named)


def _ask(question: str, proposed: str, read: Callable[[str], Answer]) -> Answer:
    """The answer to a question, asked again until it can be read."""
    while True:
        text: str = typer.prompt(question, default=proposed, err=True)
        try:
            return read(text.strip())
        except InputError as error:
            _say(f"  {error}")


def _yes(question: str, proposed: bool) -> bool:
    return typer.confirm(question, default=proposed, err=True)


def _typed(check: Callable[[str, str], object], axis: str, text: str) -> str:
    """What was typed, if it can be read."""
    check(axis, text)
    return text


def _say(text: str) -> None:
    typer.echo(text, err=True)
