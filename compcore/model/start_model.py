"""The start model: every error motion of every axis, and the thermal effects of known sensors.

No values yet: `abbe.compcore.fitting` finds those. What a campaign cannot determine the fit says
itself, and what is missing the diagnosis proposes; so this holds what every machine of its
structure has, and nothing that only some have.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.registry import make_effect
from abbe.compcore.effects.targets import turned_about
from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import WHOLE_TURN, Axis, Machine, Signal, own_component
from abbe.compcore.model.model import Model

_BY_LENGTH = 100.0
"""mm of travel for each further coefficient of a spline …"""
_ENDS = 4
"""… beyond these …"""
_FEWEST, _MOST = 6, 16


@dataclass(frozen=True, slots=True)
class StartOptions:
    """Options of a start model: how the machine will be measured.

    Attributes
    ----------
    play
        Lines are measured in both directions: the play of each linear axis.
    rotary_motions
        Rotary axes' own error motions are measured (R-test, autocollimator), not only where their
        lines lie.
    tool_lengths
        Tools of different lengths are used: how the spindle leans.
    shape
        Shape of linear axes' error motions; None: a spline by the length of the travel.
    positioning_only
        Of the axes' own motions only positioning and, where asked for, play: what tables over an
        axis's own position hold, and lines along the axes show.
    bare
        No effects at all: the machine, its axes and sensors. What it needs, the diagnosis finds.
    """

    play: bool = False
    rotary_motions: bool = False
    tool_lengths: bool = False
    shape: str | None = None
    bare: bool = False
    positioning_only: bool = False


def usual_shape(axis: Axis) -> str:
    """The usual shape of an axis's error motions: spline:4 + travel/100 mm, 6 to 16.

    Twice as many measured positions along the axis determine it well.

    >>> usual_shape(Axis("X", (0.0, 700.0)))
    'spline:11'
    """
    count = _ENDS + round(2.0 * axis.half_travel / _BY_LENGTH)
    return f"spline:{min(max(count, _FEWEST), _MOST)}"


def start_model(machine: Machine, wanted: StartOptions | None = None) -> Model:
    """The start model of a machine, without values, ready for `fit`.

    Raises
    ------
    InputError
        For a shape that does not exist, or a table, whose positions nobody has stated.
    """
    wanted = wanted or StartOptions()
    if wanted.shape == "table":
        raise InputError(
            "a table needs its positions",
            field="shape",
            found=wanted.shape,
            expected="spline:N, polynomial:N or constant; tables stand in the model file",
        )
    if wanted.bare:
        return Model(machine)
    effects = list(_effects(machine, wanted))
    for effect in effects:
        effect.check(machine)
    return Model(machine).with_effects(*effects)


def bare(model: Model) -> bool:
    """Whether a start model holds no error to be fitted: none, or how its two drives are read."""
    return all(effect.kind == "two_drives" for effect in model.effects)


def _effects(machine: Machine, wanted: StartOptions) -> Iterator[Effect]:
    for name in machine.structure.axes:
        axis = machine.axes[name]
        yield from _rotary(axis, wanted) if axis.rotary else _linear(axis, wanted)
    pairs = combinations(machine.structure.linear, 2)
    for first, second in () if wanted.positioning_only else pairs:
        if own_component(first) != own_component(second):
            yield make_effect("squareness", {"axes": [first, second]})
    head = any(machine.axes[a].rotary for a in machine.structure.tool_side)
    if head and not wanted.positioning_only:
        yield make_effect("spindle_location", {})
    if wanted.tool_lengths and not machine.structure.spindle_on_workpiece:
        along = _spindle(machine)
        for direction in "XYZ":
            if direction != along:
                yield make_effect("spindle_squareness", {"direction": direction})
    yield from _thermal(machine)


def _linear(axis: Axis, wanted: StartOptions) -> Iterator[Effect]:
    """The six error motions of a carriage, and its play."""
    shape = usual_shape(axis) if wanted.shape is None else wanted.shape
    where = {"axis": axis.name, "shape": shape}
    yield make_effect("positioning", where)
    if not wanted.positioning_only:
        for direction in "XYZ":
            if direction != own_component(axis.name):
                yield make_effect("straightness", where | {"direction": direction})
        for about in "XYZ":
            yield make_effect("angular", where | {"about": about})
    if wanted.play:
        yield make_effect("backlash", {"axis": axis.name})


def _rotary(axis: Axis, wanted: StartOptions) -> Iterator[Effect]:
    """Where the axis's line lies, and how far the axis turns too far; its other motions on wish."""
    form: dict[str, str] = {"axis": axis.name}
    if 2.0 * axis.half_travel < WHOLE_TURN:
        form["shape"] = "spline:6"
    if not wanted.positioning_only:
        yield make_effect("rotary_location", {"axis": axis.name})
    yield make_effect("rotary_positioning", form)
    if wanted.positioning_only or not wanted.rotary_motions:
        return
    across = [d for d in "XYZ" if d != turned_about(axis.name)]
    yield make_effect("rotary_axial", form)
    for kind in ("rotary_radial", "rotary_tilt"):
        for direction in across:
            yield make_effect(kind, form | {"direction": direction})


def _thermal(machine: Machine) -> Iterator[Effect]:
    """What the machine's thermometers explain, each by what it is fixed to.

    The workpiece's is left out: a laser's lines are not the workpiece's, and would be fitted to it.
    """
    warm = [s for s in machine.signals.values() if s.temperature]
    for name in machine.structure.linear:
        scales = [s.name for s in _at(warm, "scale", name)]
        if scales:
            yield make_effect("scale_expansion", {"axis": name, "signals": scales})
        for screw in _at(warm, "screw", name)[:1]:
            yield make_effect("screw_heating", {"axis": name, "signal": screw.name})
    for sensor in _at(warm, "spindle", None)[:1]:
        along = _spindle(machine)
        yield make_effect("thermal_offset", {"direction": along, "signal": sensor.name})


def _at(signals: list[Signal], role: str, axis: str | None) -> list[Signal]:
    return [s for s in signals if s.role == role and (axis is None or s.axis == axis)]


def _spindle(machine: Machine) -> str:
    name = machine.structure.spindle
    return "Z" if name is None else turned_about(name)
