"""Drawings of set-ups on machines without X, Y or Z: seen square to their plane, arms by joints."""

import re

import numpy as np
import pytest

from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.compcore.planning.setups.lines import axis_lines
from abbe.compcore.planning.setups.rotations import turns
from abbe.compcore.planning.targets import SurveyTask
from abbe.daemon.report.measurements.survey import picture
from abbe.daemon.report.pictures.still import still

LATHE = Machine(
    "lathe", Structure.parse("w (C') b Z X t"),
    {"Z": Axis("Z", (0.0, 600.0)), "X": Axis("X", (0.0, 250.0))},
)  # fmt: skip
RAIL = Machine("rail", Structure.parse("w b X t"), {"X": Axis("X", (0.0, 2000.0))})
SCARA = Machine(
    "SCARA", Structure.parse("w b C C2 Z t"),
    {"C": Axis("C", (-2.0, 2.0)), "C2": Axis("C2", (-2.4, 2.4), location=(325.0, 0.0, 0.0)),
     "Z": Axis("Z", (-200.0, 0.0))},
)  # fmt: skip


def task(machine: Machine) -> SurveyTask:
    return SurveyTask(Model(machine), tools={"P": (550.0, 0.0, -50.0)})


@pytest.mark.parametrize(("machine", "titles"), [(LATHE, ["Z, mm", "X, mm"]), (RAIL, ["X, mm"])])
def test_what_lies_in_a_plane_is_seen_square_to_it(machine, titles):
    own = task(machine)
    setup = next(axis_lines(own, INSTRUMENTS["laser"]))
    drawn = still(picture(own, setup))
    words = re.findall(r'<text x="([-\d.]+)" y="([-\d.]+)"[^>]*>([^<]*)<', drawn)
    assert [text for *_, text in words if text.endswith("mm")] == titles
    # no number stands on another
    places = np.array([(float(x), float(y)) for x, y, _ in words])
    apart = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
    assert apart[~np.eye(len(places), dtype=bool)].min() > 12.0


def test_a_joint_draws_the_arc_that_the_tip_goes():
    own = task(SCARA)
    setup = next(s for s in turns(own, INSTRUMENTS["rotary-calibrator"]) if s.axis == "C2")
    reach, way = picture(own, setup)["data"][:2]
    away = np.hypot(np.array(way["x"]) - 325.0, np.array(way["y"]))
    np.testing.assert_allclose(away, 225.0, atol=1e-9)
    assert np.ptp(np.array(way["y"])) > 225.0
    # nowhere farther than both links, and as far as that
    assert np.nanmax(np.hypot(reach["x"], reach["y"])) == pytest.approx(550.0)
