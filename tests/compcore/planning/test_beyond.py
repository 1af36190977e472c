"""Beyond a target: no bar is torn off, no beam lost; and the stop where a person puts it on."""

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.planning.instruments import instruments_called
from abbe.compcore.planning.motion import steps_of
from abbe.compcore.planning.setups.candidates import possible
from abbe.compcore.planning.targets import SurveyTask
from tests.support.compcore.survey_machines import task

BAR_RANGE = 1.0
"""mm by which a ball bar may be longer or shorter than its length."""


def measured(name, instrument, kind=""):
    """A set-up of some machine, and where the axes stand from the stop before its first target."""
    aim = task(name)
    setup = next(
        s for s in possible(aim, instruments_called([instrument])) if s.what.startswith(kind)
    )
    setup = replace(setup, name="s", runs=2)
    at, places = {}, None
    for step in steps_of(aim.machine, [setup], aim.space):
        at = at | dict(step.at)
        if step.kind == "there":
            places = []
        if places is not None:
            places.append(dict(at))
    assert places is not None
    # the last move draws the tool back
    return aim, setup, places[:-1]


def test_a_ball_bar_is_never_out_of_its_range():
    """Also where the circle begins and turns; before, it was pulled out by 2 mm and more."""
    _, setup, places = measured("bridge", "ball-bar")
    middle = np.array(setup.optics["the ball stands"])
    tips = np.array([[p[a] for a in "XYZ"] for p in places]) + setup.offset
    radius = np.linalg.norm(tips - middle, axis=1)
    nominal = np.linalg.norm(setup.path()[0] - middle)
    assert np.abs(radius - nominal).max() < 0.5 * BAR_RANGE
    assert len(places) > 2 * 2 * setup.count


def test_an_r_test_stays_within_its_range():
    aim, setup, places = measured("rotary table", "r-test")
    at = {a: np.array([p[a] for p in places]) for a in places[0]}
    # in the middle of every move, too: the sphere has to follow its arc, not its chord
    at = {a: np.concatenate([q, 0.5 * (q[1:] + q[:-1])]) for a, q in at.items()}
    count = len(at["X"])
    conditions = Conditions(at, tool=np.tile(np.asarray(setup.offset), (count, 1)))
    tips = np.asarray(Chain(aim.machine, conditions).point)
    assert np.ptp(tips, axis=0).max() < 0.5 * BAR_RANGE


@pytest.mark.parametrize("kind", ["body diagonal", "face diagonal"])
def test_a_diagonal_s_reflector_stays_in_the_beam(kind):
    """A beam of 6 mm that comes back 4 mm aside is lost: so it was, 2 mm beside an uneven line."""
    _, setup, places = measured("horizontal-arm", "laser", kind)
    tips = np.array([[p[a] for a in "XYZ"] for p in places]) + setup.offset
    line = setup.path()
    along = (line[-1] - line[0]) / np.linalg.norm(line[-1] - line[0])
    beside = (tips - line[0]) - np.outer((tips - line[0]) @ along, along)
    assert np.linalg.norm(beside, axis=1).max() < 0.5
    # and it does go beyond both ends: every axis comes back to them
    reach = (tips - line[0]) @ along
    assert reach.min() < -1.0
    assert reach.max() > np.linalg.norm(line[-1] - line[0]) + 1.0


def test_every_planned_r_test_has_a_way_to_its_next_target():
    """Of a swivelling table on X, between angles that are reached its sphere left Z's travel."""
    lines = {"B": "[-90.0, 90.0]", "C": "[-360.0, 360.0]"}
    text = 'format = "abbe-model/1"\n[machine]\nname = "T"\nstructure = "w C\' B\' X\' b Y Z t"\n'
    for axis, travel in {"X": "[0.0, 500.0]", "Y": "[0.0, 450.0]", "Z": "[-50.0, 400.0]"}.items():
        text += f"[machine.axes.{axis}]\ntravel = {travel}\n"
    for axis, travel in lines.items():
        place = "location = [250.0, 225.0, 100.0]"
        text += f"[machine.axes.{axis}]\ntravel = {travel}\n{place}\n"
    aim = SurveyTask(parse_model(TomlSource(text)), tools={"P": (0.0, 0.0, -120.0)})
    setups = [
        s
        for s in possible(aim, instruments_called(["r-test"]))
        if aim.space.hindrance(aim.machine, s) is None
    ]
    assert {s.axis for s in setups} == {"B", "C"}
    for setup in setups:
        steps = list(steps_of(aim.machine, [replace(setup, name="s")], aim.space))
        assert sum(step.kind == "target" for step in steps) == 2 * setup.count
