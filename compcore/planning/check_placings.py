"""Set-ups that are no lines, to verify by: ball bar, R-test, sphere, plate, tracker, elsewhere.

Each where usual plans do not have it: other heights, other places on the table, other angles.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from abbe.compcore.planning.instruments import PlannedInstrument
from abbe.compcore.planning.plan import SurveyPlan
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups.plates import probed_plates
from abbe.compcore.planning.setups.points import ball_bars, ball_plates, distances
from abbe.compcore.planning.setups.poses import poses
from abbe.compcore.planning.setups.rotations import spheres
from abbe.compcore.planning.targets import SurveyTask

PLACED = ("ball-bar", "r-test", "sphere", "ball-plate", "tracker", "laser-tracker")
"""Instruments whose set-ups are judged by their ranges, not as lines."""
_PARTS = (0.35, 0.65)
"""Where circles and plates lie, parts of the travel that they do not use."""
_OUT, _UP = (120.0,), (130.0,)
"""How far from the axis's line a sphere stands, and how high, mm."""
_FLAT, _LEANING = (0.5,), (0.25, 0.75)
"""Heights of a plate that the machine touches, parts of the room: not those of usual plans."""
_PLACES = ((0.5,), (0.25, 0.75))
"""Where it then lies in the other two directions, likewise."""
_BASES = {
    "the side of low X": (0.02, 0.5), "the side of high X": (0.98, 0.5),
    "the side of low Y": (0.5, 0.02), "the side of high Y": (0.5, 0.98),
}  # fmt: skip
_STANDS = {"its front left": 45.0, "its front right": -45.0}
"""Beside machines that reach points by joints."""
_POINTS, _SEED = 40, 230
"""Of the distances from there, other points than those of usual plans."""
_OTHERS = (None, 0.4)
"""Where other rotary axes stand: at 0, or at a part of their travel."""


def placings(task: SurveyTask, instrument: PlannedInstrument) -> Iterator[PlannedSetup]:
    """What an instrument can check a machine by, one run each; nothing for one of lines."""
    if instrument.key == "ball-bar":
        yield from ball_bars(task, instrument, _PARTS)
    elif instrument.key in ("r-test", "sphere"):
        yield from spheres(task, instrument, _OUT, _UP, _OTHERS, more=2)
    elif instrument.key == "ball-plate" and task.plate is not None:
        yield from probed_plates(task, instrument, task.plate, _FLAT, _LEANING, _PLACES)
    elif instrument.key in ("tracker", "laser-tracker"):
        yield from distances(task, instrument, seed=_SEED, count=_POINTS, bases=_BASES)
        yield from poses(task, instrument, _STANDS, _POINTS, _SEED, some=False)
    elif instrument.key == "ball-plate":
        yield from ball_plates(task, instrument, _PARTS, (0.5,))


def nowhere_else(task: SurveyTask) -> bool:
    """Whether a line along an axis has only one place to lie: no other linear axis is there."""
    return len(task.machine.structure.linear) == 1


def apart_by_name(plan: SurveyPlan, *, every: bool = False) -> SurveyPlan:
    """The plan with names that no fitted set-up of these instruments has; of lines where `every`.

    One of the same name in the same region would be taken for the rest of it.
    """
    steps = tuple(
        replace(step, setup=replace(step.setup, name=f"{step.setup.name}_check"))
        if every or step.setup.instrument.key in PLACED
        else step
        for step in plan.steps
    )
    return replace(plan, steps=steps)


def one_of_each(pool: Sequence[PlannedSetup]) -> Iterator[PlannedSetup]:
    """The first set-up of every rotary axis, of every plane, and of distances."""
    seen = set()
    for setup in pool:
        kind = setup.axis or re.split(", | at | from ", setup.what)[0]
        if setup.instrument.key in PLACED and kind not in seen:
            seen.add(kind)
            yield setup
