"""More time than there is to do: a plan ends, and every set-up in it does something."""

import numpy as np

from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.start_model import StartOptions, start_model
from abbe.compcore.planning.choice import Knowledge
from abbe.compcore.planning.instruments import instruments_called
from abbe.compcore.planning.knowledge import CHANGED, VolumeError, added, prior
from abbe.compcore.planning.plan import plan_preset, plan_survey
from abbe.compcore.planning.setups.presets import PRESETS
from abbe.compcore.planning.targets import SurveyTask

HOUR = 3600.0


def test_a_rail_s_plan_of_40_hours_is_short_and_every_set_up_does_something():
    """It had every gauge block three times in its one place, none of which changed anything."""
    rail = Machine("rail", Structure.parse("w b X t"), {"X": Axis("X", (0.0, 3000.0))})
    aim = SurveyTask(start_model(rail, StartOptions(play=True)))
    at_hand = instruments_called(["laser", "step-gauge", "gauge-block", "angle"])
    plan = plan_survey(aim, at_hand, 40 * HOUR, compare=True)
    words = [step.setup.what for step in plan.steps]
    named = {(step.setup.instrument.key, step.setup.what) for step in plan.steps}
    assert len(named) == len(plan.steps)
    assert not [w for w in words if w.endswith("at ")]
    assert plan.seconds < 3 * HOUR
    start = Knowledge.beforehand(prior(aim.model, CHANGED), VolumeError.of(aim))
    for idle in plan.steps:
        known = start
        for step in plan.steps:
            if step is not idle:
                known = known.with_(added(aim, step.setup), step.setup.runs)
        assert np.sqrt(known.variance) > plan.after * (1.0 + 4e-4), idle.setup.what
    # presets are given the time that the plan takes, not what there is
    assert plan.presets is not None
    same = plan_preset(aim, PRESETS["iso230-2"], plan.seconds)
    assert np.isclose(plan.presets["iso230-2"], same.after)
