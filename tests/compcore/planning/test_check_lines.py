"""Lines of a check plan beside what was really measured: never twice at the same figure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.overlap import SAME_TARGET, overlap
from abbe.compcore.planning.check_lines import plan_check
from abbe.compcore.planning.check_placings import placings
from abbe.compcore.planning.instruments import INSTRUMENTS, instruments_called
from abbe.compcore.planning.plan import campaign_of
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups.lines import axis_lines
from abbe.compcore.planning.setups.points import gauge_blocks
from abbe.compcore.planning.targets import SurveyTask
from abbe.compcore.verification.fitted import FittedPart, fitted_lines
from tests.compcore.planning.test_check_placings import HOUR, five_axes

LASER = INSTRUMENTS["laser"]


def as_indicated(
    task: SurveyTask, setups: list[PlannedSetup], aside: float, name: str = "s"
) -> Campaign:
    """A plan's rows where a machine really stands: `aside` mm off, counts that never repeat."""
    named = [replace(s, name=f"{name}{i}") for i, s in enumerate(setups)]
    rows = campaign_of(task, named)
    rng = np.random.default_rng(1)
    at = {
        a: q + (aside if a in "XYZ" else 0.0) + 1e-5 * rng.standard_normal(len(q))
        for a, q in rows.conditions.positions.items()
    }
    return replace(rows, conditions=replace(rows.conditions, positions=at))


def test_a_line_that_was_driven_is_known_again_although_no_axis_ever_stands_still() -> None:
    task = five_axes()
    everywhere = ((0.3, 0.3), (0.3, 0.7))
    fitted = [s for s in axis_lines(task, LASER, everywhere) if s.axis == "X"]
    done = as_indicated(task, fitted, 0.0)
    check = plan_check(task, [LASER], 2.0 * HOUR, done, runs=1)
    lines = [s.setup for s in check.steps if s.setup.axis == "X"]
    assert lines
    for line in lines:
        for old in fitted:
            apart = [
                abs(line.targets[a][0] - old.targets[a][0]) / task.machine.axes[a].half_travel / 2.0
                for a in "YZ"
            ]
            assert max(apart) >= 0.05, line.what


def test_a_gauge_that_lay_a_little_aside_is_not_laid_there_again() -> None:
    """Seen at a step gauge that was touched: two of four checks were fitted placings."""
    task, at_hand = five_axes(), instruments_called(["gauge-block"])
    block = at_hand[0]
    fitted = [s for s in gauge_blocks(task, block) if "300 mm" in s.what]
    done = as_indicated(task, fitted, 1.2)
    check = plan_check(task, at_hand, 2.0 * HOUR, done, runs=1)
    old = {s.what for s in fitted}
    assert not old & {s.setup.what for s in check.steps}


def test_targets_driven_to_again_are_the_same_within_a_tenth_of_a_millimetre() -> None:
    task = five_axes()
    lines = [s for s in axis_lines(task, LASER, ((0.3, 0.3),)) if s.axis in ("X", "Y")]
    fitted = as_indicated(task, lines, 0.0)
    again, other = (as_indicated(task, lines, a, "t") for a in (0.05, 0.3))
    assert overlap(fitted, again).setups == ()
    assert overlap(fitted, again, SAME_TARGET).setups == ("t0", "t1")
    assert overlap(fitted, other, SAME_TARGET).setups == ()
    assert fitted_lines(again, task.model, fitted) == dict.fromkeys(("t0", "t1"), FittedPart.POINTS)
    assert fitted_lines(other, task.model, fitted) == {}


def test_a_circle_that_was_driven_is_not_driven_again() -> None:
    task, bar = five_axes(), INSTRUMENTS["ball-bar"]
    circles = list(placings(task, bar))
    done = as_indicated(task, circles[:1], 0.05)
    for fitted, old in ((None, True), (done, False)):
        check = plan_check(task, [bar], 4.0 * HOUR, fitted, runs=1)
        assert (circles[0].what in {s.setup.what for s in check.steps}) is old
