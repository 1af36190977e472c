"""A model file for people to go on with: each section says in plain words what it is for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any

import tomli_w

from abbe.compcore.effects.base import Effect, ErrorMotion
from abbe.compcore.effects.catalogue.rotary.over_an_arc import RotaryMotion
from abbe.compcore.effects.catalogue.shaped import ShapedEffect
from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.files.model_file import document_of, parse_model
from abbe.compcore.files.text.atomic import write_atomically
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.model.model import Model
from abbe.compcore.model.start_model import bare

_HEAD = """\
# A start model, made by `abbe new`: what the machine is made of, and which errors to look for.
# It holds no values yet. Measure, then
#     abbe fit {name} CAMPAIGN.csv -o fitted.toml
# finds them all, and says which of them the measurements cannot tell.
# Every key is explained in docs/model.md, every effect by `abbe effects KIND`.
"""
_BARE_HEAD = """\
# A machine whose effects are not known yet, made by `abbe new --bare`. Measure, then
#     abbe diagnose {name} CAMPAIGN.csv --apply -o found.toml
# finds the effects that the measurements show, one after another.
# Every key is explained in docs/model.md, every effect by `abbe effects KIND`.
"""
_MACHINE = {
    "structure": """\
# From the workpiece w over the bed b to the tool t. Axes with a prime carry the workpiece; a
# letter in brackets is a spindle. The order decides over the levers: check it.
""",
    "reference_temperature": "# The temperature to which lengths are referred (ISO 1).\n",
}
_UNITS = {
    "reference_temperature": "  # °C",
    "location": "  # mm: a point of this axis's line, machine coordinates, all axes at zero",
}
_AXES = """
# How far each axis travels, as the controller shows it: mm, rotary axes degrees. Beyond these ends
# errors are held.
"""
_RADIUS = """\
# X is a radius, the travel of the slide: half of what a control shows as a diameter. So are all
# positions of X in campaigns and tables, and what a configuration reads (a scale of 0.5).
"""
_SIGNALS = """
# What is recorded beside the positions: one column of this name in every campaign, and later one
# [signals.NAME] in the configuration of `abbe run`. Signals that no effect below uses are tried by
# `abbe diagnose`, which says what they explain.
"""
_NO_SIGNALS = """
# No thermometers. To add one:
#     [machine.signals.T_x]
#     unit = "degC"
#     role = "scale"             # or screw, spindle, structure, ambient, workpiece, load, speed, …
#     axis = "X"
"""
_CARRIAGE = {
    False: """
# The {axis} carriage. A rigid body has six error motions: it arrives short or beyond, leaves its
# line sideways in two directions, and turns by small angles about three.
""",
    True: """
# Rotary axis {axis}: where its line really lies, and how it moves while it turns.
""",
}
_BETWEEN = {
    "squareness": """
# How square the linear axes stand to each other, in the structure's order.
""",
    "spindle_location": """
# Where the head holds its spindle: the pivot length, and how far beside the head's line it sits.
""",
    "spindle_squareness": """
# How the spindle leans. Tools of different lengths show it; with one length it is only a shift.
""",
}
_THERMAL = ("scale_expansion", "screw_heating", "thermal_offset")
_WARMTH = """
# What warms, grows. Measure once cool and once warm, or through a warm-up: one temperature says
# nothing.
"""
_MEANS = {
    "positioning": "arrives short of its indicated position, or beyond",
    "straightness": "leaves its straight line in {direction}",
    "angular": "turns about {about}",
    "backlash": "stands elsewhere when it arrives from the other side",
    "rotary_location": "crosses elsewhere, leans, and begins to count elsewhere",
    "rotary_positioning": "turns too far, or not far enough",
    "rotary_axial": "moves along its own line while it turns",
    "rotary_radial": "wanders in {direction} while it turns",
    "rotary_tilt": "wobbles about {direction} while it turns",
    "squareness": "between {axes[0]} and {axes[1]}",
    "spindle_location": "pivot length, and what lies across it",
    "spindle_squareness": "leans towards {direction}",
    "scale_expansion": "its scale grows with the mean of these thermometers",
    "screw_heating": "its screw stretches away from the fixed bearing",
    "thermal_offset": "the spindle grows in {direction}",
}


def save_commented(model: Model, path: str | Path) -> None:
    """Write a model that has no values yet, with comments, atomically.

    Raises
    ------
    InputError
        When the file cannot be written.
    AbbeError
        When `load_model` would not give the same model back, as where it has values: nothing is
        written then.
    """
    text = format_commented(model, Path(path).name)
    try:
        again = parse_model(TomlSource(text))
    except InputError as error:
        raise AbbeError(
            f"{path}: not written, as no such model can be read again: {error}"
        ) from None
    if again != model:
        raise AbbeError(f"{path}: not written, as another model would be read from it")
    write_atomically(path, text)


def format_commented(model: Model, name: str) -> str:
    """The text of the model file called `name`."""
    return "".join(_pieces(model, name if name.isprintable() else "MODEL.toml"))


def _pieces(model: Model, name: str) -> Iterator[str]:
    machine = model.machine
    document = document_of(model)
    section = document["machine"]
    axes, signals = section.pop("axes"), section.pop("signals", {})
    yield (_BARE_HEAD if bare(model) else _HEAD).format(name=name)
    yield _line("format", document["format"])
    yield "\n[machine]\n"
    for key, value in section.items():
        yield _MACHINE.get(key, "") + _line(key, value)
    yield _AXES
    for axis, table in axes.items():
        if is_rotary(axis):
            table.setdefault("location", list(machine.axes[axis].location))
        note = _RADIUS if axis == "X" and machine.structure.shows_diameters else ""
        yield note + f"[machine.axes.{axis}]\n" + _lines(table)
    yield _SIGNALS if signals else _NO_SIGNALS
    for signal, table in signals.items():
        yield f"[machine.signals.{_key(signal)}]\n" + _lines(table)
    pairs = zip(model.effects, document["effects"], strict=True)
    for heading, effects in groupby(pairs, lambda pair: _heading(pair[0])):
        sections = ["[[effects]]" + _meaning(effect) + "\n" + _lines(t) for effect, t in effects]
        yield heading + "\n".join(sections)


def _heading(effect: Effect) -> str:
    """What stands above an effect and those like it."""
    if effect.kind in _THERMAL:
        return _WARMTH
    if effect.kind in _BETWEEN:
        return _BETWEEN[effect.kind]
    axis = effect.where()["axis"]
    return _CARRIAGE[is_rotary(axis)].format(axis=axis)


def _meaning(effect: Effect) -> str:
    """The effect's error motion by its name in ISO 230-1, and what that is."""
    words = _MEANS.get(effect.kind, "").format(**effect.where())
    if isinstance(effect, ShapedEffect | RotaryMotion) and effect.kind != "backlash":
        words = f"{ErrorMotion(effect.axis, effect.component())}: {words}"
    return "  # " + words if words else ""


def _lines(table: Mapping[str, Any]) -> str:
    return "".join(_line(key, value) for key, value in table.items())


def _line(key: str, value: Any) -> str:
    return f"{key} = {_value(value)}" + _UNITS.get(key, "") + "\n"


def _value(value: Any) -> str:
    """A value in one line; `tomli_w` gives each part of a list a line of its own."""
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    return tomli_w.dumps({"v": value}).removeprefix("v = ").rstrip("\n")


def _key(name: str) -> str:
    """A signal's name as a key: in quotes where it needs them."""
    return tomli_w.dumps({name: 0}).removesuffix(" = 0\n")
