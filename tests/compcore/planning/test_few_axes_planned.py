"""Plans for machines without one of X, Y, Z: what no axis corrects is no reason to measure."""

import numpy as np
import pytest

from abbe.compcore.campaign.overlap import SAME_TARGET, overlap
from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.start_model import StartOptions, start_model
from abbe.compcore.planning.check_lines import plan_check
from abbe.compcore.planning.instruments import INSTRUMENTS, instruments_called
from abbe.compcore.planning.knowledge import VolumeError
from abbe.compcore.planning.plan import plan_survey
from abbe.compcore.planning.setups.rotations import spheres
from abbe.compcore.planning.targets import SurveyTask

HOUR = 3600.0
RAIL = Machine("rail", Structure.parse("w b X t"), {"X": Axis("X", (0.0, 2000.0))})
LATHE = Machine(
    "lathe", Structure.parse("w (C') b Z X t"),
    {"Z": Axis("Z", (0.0, 600.0)), "X": Axis("X", (0.0, 250.0))},
)  # fmt: skip
ARM = Machine(
    "arm", Structure.parse("w b C C2 t"),
    {"C": Axis("C", (-2.0, 2.0)), "C2": Axis("C2", (-2.4, 2.4), location=(325.0, 0.0, 0.0))},
)  # fmt: skip


def task(machine: Machine) -> SurveyTask:
    model = start_model(machine, StartOptions(play=True, rotary_motions=True))
    return SurveyTask(model, tools={"P": (550.0, 0.0, 0.0)})


def planned(machine: Machine, *keys: str):
    return plan_survey(task(machine), instruments_called(keys), 3.0 * HOUR)


@pytest.mark.parametrize(
    ("machine", "counted"), [(RAIL, "X"), (LATHE, "XZ"), (ARM, "XY")], ids=["rail", "lathe", "arm"]
)
def test_what_no_axis_moves_is_not_counted(machine, counted):
    field = VolumeError.of(task(machine)).field
    size = np.abs(field.reshape(-1, 3, field.shape[1])).max(axis=(0, 2))
    assert [k for k, s in zip("XYZ", size, strict=True) if s > 1e-9] == list(counted)


def test_a_laser_along_its_line_is_enough_for_a_rail_and_is_set_up_once():
    plan = planned(RAIL, "laser")
    assert [s.setup.what for s in plan.steps] == ["positioning of X"]
    # were straightness counted that nobody can correct, most would stay
    assert plan.stays is not None
    assert plan.stays < 0.1


def test_a_rail_is_checked_on_its_only_line_between_the_fitted_targets():
    plan = planned(RAIL, "laser")
    fitted = plan.rows()
    check = plan_check(task(RAIL), instruments_called(["laser"]), HOUR, fitted, runs=2)
    (step,) = check.steps
    assert step.setup.what == "positioning of X"
    apart = np.abs(step.setup.targets["X"][:, None] - plan.steps[0].setup.targets["X"])
    assert apart.min() > SAME_TARGET
    assert np.ptp(step.setup.targets["X"]) > 0.9 * 2000.0
    assert overlap(fitted, check.rows(), SAME_TARGET).setups == ()


def test_what_shows_only_what_no_axis_corrects_is_refused():
    with pytest.raises(InputError, match="nothing surer that the machine's axes can correct"):
        planned(RAIL, "straightness")


def test_nothing_is_read_square_to_the_plane_of_a_lathe():
    plan = planned(LATHE, "laser", "straightness")
    assert {s.setup.instrument.key for s in plan.steps} == {"laser", "straightness"}
    assert all(not s.setup.u[:, :, 1].any() for s in plan.steps)


def test_a_table_is_shown_by_an_r_test_while_the_quill_stands_drawn_back():
    """A boring mill's W begins at 0, where it stands: no room to come from there, and no need."""
    travels = {"X": (0.0, 2000.0), "Z": (0.0, 1200.0), "Y": (0.0, 1500.0), "W": (0.0, 500.0)}
    axes = {a: Axis(a, travel) for a, travel in travels.items()}
    axes["B"] = Axis("B", (0.0, 6.283), location=(1000.0, 0.0, 600.0))
    mill = Machine("boring mill", Structure.parse("w B' X' Z' b Y W (C) t"), axes)
    own = SurveyTask(start_model(mill, StartOptions(play=True)), tools={"P": (0.0, 0.0, -200.0)})
    setups = list(spheres(own, INSTRUMENTS["r-test"]))
    assert {s.axis for s in setups} == {"B"}
    assert all(not s.targets["W"].any() for s in setups)
    assert all(own.space.hindrance(mill, s) is None for s in setups)
