"""Points in space of arms: where joints take the tip, by transforms written out apart."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.campaign.overlap import SAME_TARGET, overlap
from abbe.compcore.effects.registry import make_effect
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from abbe.compcore.planning.check_lines import plan_check
from abbe.compcore.planning.drawing_back import draws_back
from abbe.compcore.planning.envelope import KeepOut, WorkingSpace
from abbe.compcore.planning.instruments import INSTRUMENTS, instruments_called
from abbe.compcore.planning.motion import steps_of
from abbe.compcore.planning.plan import plan_survey
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups.poses import poses
from abbe.compcore.planning.setups.seen import between
from abbe.compcore.planning.simulation import carry_out
from abbe.compcore.planning.targets import SurveyTask
from tests.support.compcore.arm_points import JOINTS, arm, tips

TRAVELS = dict(
    zip(JOINTS, ((-2.8, 2.8), (-1.4, 1.5), (-2.2, 0.9), (-3.0, 3.0), (-2.0, 2.0), (-3.0, 3.0)),
        strict=True)
)  # fmt: skip
TOOL = (980.0, 30.0, 1350.0)
FLOOR = KeepOut((-4000.0, -4000.0, -900.0), (4000.0, 4000.0, 0.0))


def task(*boxes: KeepOut) -> SurveyTask:
    machine = arm()
    axes = {a: replace(own, travel=TRAVELS[a]) for a, own in machine.axes.items()}
    effects = [make_effect("rotary_location", {"axis": joint}) for joint in JOINTS]
    model = Model(replace(machine, axes=axes)).with_effects(
        *effects, make_effect("spindle_location", {})
    )
    return SurveyTask(model, WorkingSpace(boxes), {"F": TOOL})


def where(setup: PlannedSetup) -> np.ndarray:
    q = np.stack([setup.targets[joint] for joint in JOINTS], axis=1)
    return tips(q, np.tile(TOOL, (len(q), 1)))


@pytest.fixture(scope="module")
def seen() -> list[PlannedSetup]:
    return list(poses(task(), INSTRUMENTS["laser-tracker"], some=False))


def test_poses_use_all_of_every_joint_and_keep_their_distance_from_the_tracker(seen):
    assert len(seen) == 3
    for setup in seen:
        assert setup.count == 100
        assert (setup.kind, setup.free) == (Kind.DISPLACEMENT, ("frame",))
        for joint, (low, high) in TRAVELS.items():
            assert np.ptp(setup.targets[joint]) > 0.93 * (high - low)
        (place,) = setup.optics.values()
        far = np.linalg.norm(where(setup) - np.array(place), axis=1)
        assert far.min() > INSTRUMENTS["laser-tracker"].nearest
        expected = np.hypot(0.01, 5e-6 * far)
        assert np.allclose(setup.sd, expected, rtol=1e-6)


def test_a_wrist_whose_lines_meet_in_one_point_has_poses():
    """The same arm: a joint's place may be any point of its line. Every tool was held to be in the
    forearm, at whose end it begins.
    """
    aim = task()
    axes = dict(aim.machine.axes)
    axes["A6"] = replace(axes["A6"], location=axes["B5"].location)
    aim = replace(
        aim, model=Model(replace(aim.machine, axes=axes)).with_effects(*aim.model.effects)
    )
    found = list(poses(aim, INSTRUMENTS["laser-tracker"], some=False))
    assert [setup.count for setup in found] == [100] * 3


def test_the_upper_arm_stands_between_no_tip_and_the_tracker(seen):
    """The line of sight, sampled, from the column with the upper arm, by the transforms."""
    still = {"B3", "A4", "B5", "A6"}
    for setup in seen:
        q = np.stack([setup.targets[j] * (0.0 if j in still else 1.0) for j in JOINTS], axis=1)
        shoulder = tips(q * [1, 0, 0, 0, 0, 0], np.tile((85.0, 0.0, 487.0), (len(q), 1)))
        elbow = tips(q, np.tile((85.0, 0.0, 1127.0), (len(q), 1)))
        (place,) = setup.optics.values()
        part = np.linspace(0.0, 1.0, 40)[:, None, None]
        sight = np.array(place) + part * (where(setup) - np.array(place))
        link = shoulder + np.linspace(0.0, 1.0, 10)[:, None, None] * (elbow - shoulder)
        apart = np.linalg.norm(sight[:, None] - link[None], axis=3)
        assert apart.min() > 30.0


def test_no_way_between_poses_leads_into_a_box():
    (setup, *_) = poses(
        task(FLOOR), INSTRUMENTS["laser-tracker"], {"in front": 0.0}, 24, some=False
    )
    order, _ = setup.visits()
    q = np.stack([setup.targets[joint][order] for joint in JOINTS], axis=1)
    way = np.concatenate([a + np.linspace(0.0, 1.0, 20)[:, None] * (b - a)
                          for a, b in pairwise(q)])  # fmt: skip
    # 102 mm from the last joint's place to the tip
    assert tips(way, np.tile(TOOL, (len(way), 1)))[:, 2].min() > 100.0
    free = poses(task(), INSTRUMENTS["laser-tracker"], {"in front": 0.0}, 24, some=False)
    assert where(next(free))[:, 2].min() < 0.0


def test_poses_follow_each_other_in_a_short_order(seen):
    q = np.stack([seen[0].targets[joint] for joint in JOINTS], axis=1)
    rng = np.random.default_rng(0)

    def time(rows):
        return np.abs(np.diff(rows, axis=0)).max(axis=1).sum()

    assert time(q) < 0.75 * np.mean([time(rng.permutation(q)) for _ in range(20)])


def test_distances_count_from_where_the_tracker_stands_to_where_joints_take_the_tip():
    setup = next(poses(task(), INSTRUMENTS["tracker"], some=False))
    rows = setup.rows(task().machine)
    assert (rows.kind == Kind.DISTANCE).all()
    order, _ = setup.visits()
    far = np.linalg.norm(where(setup)[order] - np.array(setup.base), axis=1)
    assert np.allclose(rows.value, far, atol=1e-6)


def test_an_arm_is_planned_and_the_plan_keeps_its_word():
    plan = plan_survey(task(), instruments_called(["laser-tracker", "ball-bar"]), 2.0 * 3600.0)
    assert plan.placeless == ("ball bar",)
    assert plan.after < 0.05 * plan.before
    reached = [carry_out(plan, seed).after for seed in range(3)]
    assert plan.after / np.sqrt(np.mean(np.square(reached))) == pytest.approx(1.0, abs=0.25)
    check = plan_check(task(), instruments_called(["laser-tracker"]), 5400.0, plan.rows(), runs=1)
    assert overlap(plan.rows(), check.rows(), SAME_TARGET).setups == ()


def test_an_arm_goes_over_the_pose_of_its_zeros_where_the_straight_way_is_not_free(seen):
    """The other set-ups' poses stand still here: all that moves are the ways between them."""
    one, two = (dict.fromkeys(JOINTS, 0.0) | {"C1": c, "B2": 0.6} for c in (-0.9, 0.9))
    machine = task().machine

    def standing(at, name):
        targets = {a: np.full(2, v) for a, v in at.items()}
        u, sd = np.tile(np.eye(3), (2, 1, 1)), np.full(2, 0.02)
        return PlannedSetup(INSTRUMENTS["laser-tracker"], "", "", targets, u, Kind.DISPLACEMENT,
                            ("frame",), sd, "F", TOOL, both_ways=False, name=name)  # fmt: skip

    half = tips(np.array([[0.0, 0.6, 0, 0, 0, 0]]), np.array([TOOL]))[0]
    x, y, z = half.tolist()
    box = KeepOut((x - 10, y - 10, z - 10), (x + 10, y + 10, z + 10))
    setups = [standing(one, "s1"), standing(two, "s2")]

    def home(*boxes):
        steps = steps_of(machine, setups, WorkingSpace(boxes))
        return sum(s.kind == "move" and len(s.at) == 6 and not any(s.at.values()) for s in steps)

    assert (home(), home(box)) == (0, 1)


@pytest.mark.parametrize(
    ("code", "back"),
    [("w b C C2 Z t", True), ("w b Z C B B2 t", False), ("w b C B t", False),
     ("w C' b X Z t", True), ("w b Y X Z t", True)],
)  # fmt: skip
def test_only_a_linear_axis_beyond_the_joints_draws_a_tool_back(code, back):
    structure = Structure.parse(code)
    axes = {a: Axis(a, (-1.0, 1.0)) for a in structure.axes}
    assert draws_back(Machine("", structure, axes)) is back


def test_between_two_pieces_of_lines_by_many_points_of_both():
    rng = np.random.default_rng(3)
    a, b, c, d = rng.normal(size=(4, 200, 3))
    part = np.linspace(0.0, 1.0, 60)[:, None, None]
    many = np.linalg.norm((a + part * (b - a))[:, None] - (c + part * (d - c))[None], axis=3)
    found = between(a, b, c, d)
    assert (found <= many.min(axis=(0, 1)) + 1e-12).all()
    assert np.abs(found - many.min(axis=(0, 1))).max() < 0.06
