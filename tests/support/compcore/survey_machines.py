"""Five structures with start models that are quick to plan for."""

from __future__ import annotations

from math import radians

from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure, is_rotary
from abbe.compcore.model.start_model import StartOptions, start_model
from abbe.compcore.planning.targets import SurveyTask

STRUCTURES = {
    "bridge": ("w b Y X Z t", {"Y": (0.0, 900.0), "X": (0.0, 700.0), "Z": (-500.0, 0.0)}),
    "c-frame": ("w X' Y' b Z (C) t", {"X": (0.0, 800.0), "Y": (0.0, 500.0), "Z": (-500.0, 0.0)}),
    "gantry": ("w b X Y Z t", {"X": (0.0, 2000.0), "Y": (0.0, 1500.0), "Z": (-800.0, 0.0)}),
    "horizontal-arm": (
        "w b X Z Y t",
        {"X": (0.0, 2000.0), "Z": (0.0, 1200.0), "Y": (0.0, 1000.0)},
    ),
    "rotary table": (
        "w C' Y' b X Z (C) t",
        {"C": (0.0, 360.0), "Y": (0.0, 600.0), "X": (0.0, 600.0), "Z": (-500.0, 0.0)},
    ),
}
"""Name → structure code and travels, mm and degrees."""


def machine(name: str) -> Machine:
    """A machine of one of the structures; its rotary table stands in the middle, low down."""
    code, travels = STRUCTURES[name]
    axes = {}
    for axis, (low, high) in travels.items():
        if is_rotary(axis):
            axes[axis] = Axis(axis, (radians(low), radians(high)), location=(300.0, 300.0, -550.0))
        else:
            axes[axis] = Axis(axis, (low, high))
    return Machine(name, Structure.parse(code), axes)


def task(name: str, shape: str = "polynomial:3") -> SurveyTask:
    """To determine all error motions of one of the machines, its play and its rotary motions."""
    options = StartOptions(play=True, rotary_motions=True, shape=shape)
    return SurveyTask(start_model(machine(name), options))
