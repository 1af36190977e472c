"""What a linked interferometer would read of an arm: by transforms that are written out apart."""

import numpy as np
import pytest

from abbe.compcore.model.model import Model
from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.compcore.planning.setups.poses import poses
from abbe.compcore.planning.targets import SurveyTask
from abbe.compcore.planning.visits import SetupVisits
from abbe.daemon.config.sections.measure import InstrumentSection
from abbe.daemon.measure.following.instrument import Instrument
from tests.support.compcore.arm_points import JOINTS, arm, tips

TOOL = (980.0, 30.0, 1350.0)


def test_a_distance_counts_to_where_the_joints_take_the_reflector():
    machine = arm()
    task = SurveyTask(Model(machine), tools={"F": TOOL})
    setup = next(poses(task, INSTRUMENTS["tracker"], {"in front": 0.0}, 30, some=False))
    section = InstrumentSection(source="a.b", reads="distance")
    read = Instrument("tracker", section, "mm", machine)
    q = np.array([0.3, -0.4, 0.2, 1.0, -0.5, 0.7])
    there = np.linalg.norm(tips(q[None], np.array([TOOL]))[0] - setup.base)
    at = dict(zip(JOINTS, q.tolist(), strict=True))
    assert read.nominal(setup, at) == pytest.approx((there,), abs=1e-6)


def test_a_machine_that_stands_elsewhere_is_told_how_far_its_joints_have_to_turn():
    task = SurveyTask(Model(arm()), tools={"F": TOOL})
    setup = next(poses(task, INSTRUMENTS["tracker"], {"in front": 0.0}, 30, some=False))
    visits = SetupVisits(setup, 0.1, 1e-3)
    first = visits.target(0)
    assert visits.turn(first | {"B3": first["B3"] - 0.25, "A6": first["A6"] + 0.1}) == (
        pytest.approx(0.25)
    )
    assert visits.distance(first) == 0.0
