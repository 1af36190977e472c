"""The way from set-up to set-up with the tool drawn back: around what stands, or refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from abbe.compcore.planning.envelope import KeepOut, WorkingSpace
from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.compcore.planning.motion import steps_of
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups.lines import axis_lines
from abbe.compcore.planning.targets import SurveyTask

TOOL = np.array([0.0, 0.0, -150.0])
RADIUS = 40.0
TALL = KeepOut((100.0, 100.0, -600.0), (600.0, 800.0, -20.0))
AMIDST = KeepOut((300.0, 200.0, -600.0), (400.0, 700.0, -20.0))
"""As tall as the tool can be drawn back: nothing goes over it."""


def corners(
    places: tuple[tuple[float, float], ...] = ((0.02, 0.02), (0.98, 0.98)),
) -> tuple[Machine, list[PlannedSetup]]:
    """Positioning of Z in two places of a bridge, parts of its travels."""
    travels = {"X": (0.0, 700.0), "Y": (0.0, 900.0), "Z": (-360.0, 0.0)}
    machine = Machine(
        "bridge", Structure.parse("w b Y X Z t"), {a: Axis(a, t) for a, t in travels.items()}
    )
    task = SurveyTask(Model(machine), tools={"P": tuple(TOOL)})
    lines = axis_lines(task, INSTRUMENTS["laser"], places)
    return machine, [replace(s, name=f"z{i}") for i, s in enumerate(lines) if s.axis == "Z"]


@pytest.mark.parametrize(
    ("box", "places"),
    [
        (TALL, ((0.02, 0.02), (0.98, 0.98))),
        # one axis after the other would not do: both stand at the same Y
        (AMIDST, ((0.02, 0.5), (0.98, 0.5))),
        (AMIDST, ((0.02, 0.6), (0.98, 0.6))),
    ],
)
def test_a_box_that_nothing_passes_over_is_gone_around(
    box: KeepOut, places: tuple[tuple[float, float], ...]
) -> None:
    """Sampled densely, apart from the box's own arithmetic. Before, such a plan had no program."""
    machine, setups = corners(places)
    assert len(setups) == 2
    low, high = np.array(box.low) - RADIUS, np.array(box.high) + RADIUS
    at: dict[str, float] = {}
    inside = 0
    for step in steps_of(machine, setups, WorkingSpace((box,), radius=RADIUS)):
        if step.kind != "move":
            continue
        new = at | dict(step.at)
        if len(at) == 3:
            ends = [np.array([place[a] for a in "XYZ"]) for place in (at, new)]
            for part in np.linspace(0.0, 1.0, 60):
                tip = ends[0] + part * (ends[1] - ends[0]) + TOOL
                spindle = tip - TOOL
                beside = (tip[:2] > low[:2]).all() and (tip[:2] < high[:2]).all()
                inside += bool(beside and tip[2] < high[2] and spindle[2] > low[2])
        at = new
    assert inside == 0
    assert at["X"] == pytest.approx(setups[1].targets["X"][0])


def test_a_box_that_shuts_everything_off_is_refused() -> None:
    machine, setups = corners()
    wall = KeepOut((-200.0, 400.0, -600.0), (900.0, 500.0, -20.0))
    with pytest.raises(InputError, match="keep-out box 1"):
        steps_of(machine, setups, WorkingSpace((wall,), radius=RADIUS))
