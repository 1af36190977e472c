"""Checks of a five-axis machine by what is no line: elsewhere than it was fitted, one of each."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.overlap import overlap
from abbe.compcore.effects import make_effect
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from abbe.compcore.planning.check_lines import plan_check
from abbe.compcore.planning.instruments import instruments_called
from abbe.compcore.planning.plan import campaign_of, plan_survey
from abbe.compcore.planning.targets import SurveyTask

HOUR = 3600.0


def five_axes() -> SurveyTask:
    """A trunnion table with few effects, so that plans are quick."""
    line, turn = (300.0, 250.0, -330.0), np.radians(110.0)
    axes = {
        "X": Axis("X", (0.0, 600.0)),
        "Y": Axis("Y", (0.0, 500.0)),
        "Z": Axis("Z", (-400.0, 0.0)),
        "B": Axis("B", (-turn, turn), location=line),
        "C": Axis("C", (-np.pi, np.pi), location=line),
    }
    made = Machine("five axes", Structure.parse("w C' B' b Y X Z t"), axes)
    model = Model(made)
    for axis in "BC":
        model = model.with_effects(make_effect("rotary_location", {"axis": axis}))
    for axis in "XYZ":
        keys = {"axis": axis, "shape": "polynomial:2"}
        model = model.with_effects(make_effect("positioning", keys))
    return SurveyTask(model, tools={"P": (0.0, 0.0, -150.0)})


@pytest.mark.parametrize(
    ("instrument", "each"),
    [
        ("r-test", {"B turns", "C turns"}),
        ("sphere", {"B turns", "C turns"}),
        ("ball-bar", {"circle in XY", "circle in YZ", "circle in ZX"}),
        ("ball-plate", {"ball plate"}),
    ],
)
def test_what_is_checked_was_not_fitted_and_has_one_of_each(
    instrument: str, each: set[str]
) -> None:
    task, at_hand = five_axes(), instruments_called([instrument])
    fitted = [s.setup for s in plan_survey(task, at_hand, 2.0 * HOUR).steps]
    done = campaign_of(task, fitted)
    check = [s.setup for s in plan_check(task, at_hand, 3.0 * HOUR, done, runs=2).steps]
    for setup in check:
        assert task.space.hindrance(task.machine, setup) is None
        assert setup.name.endswith("_check")
    assert overlap(done, campaign_of(task, check)).setups == ()
    assert all(any(s.what.startswith(kind) for s in check) for kind in each)


def test_lines_come_first_where_there_is_a_laser_too() -> None:
    task, at_hand = five_axes(), instruments_called(["laser", "r-test"])
    check = [s.setup for s in plan_check(task, at_hand, 6.0 * HOUR, runs=1).steps]
    lines = {s.axis for s in check if s.instrument.key == "laser" and s.axis}
    turned = {s.axis for s in check if s.instrument.key == "r-test"}
    assert (lines, turned) == ({"X", "Y", "Z"}, {"B", "C"})
