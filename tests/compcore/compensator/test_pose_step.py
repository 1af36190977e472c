"""The live step of five-axis machines, against chains of 4×4 matrices written out apart."""

from __future__ import annotations

import math

import numpy as np
import pytest

from abbe.compcore.compensator.compensator import Compensator
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.pose import MOST_TURN, POLE, command_of
from tests.support.compcore.five_axis import (
    CODES,
    TOOL,
    angle,
    chain,
    errors_of,
    machine_of,
    model_of,
    row,
    somewhere,
)

POLES = {"head-head": "B", "table-table": "A", "mixed": "B"}


def compensator_of(name, errors, turning=None):
    machine = machine_of(CODES[name])
    rotary = machine.structure.rotary if turning is None else turning
    return machine, Compensator(model_of(machine, errors), tool=TOOL, turning=rotary)


def corrected(compensator, q):
    """Positions of all axes as they are written back, and what is said of them."""
    found = compensator.pose([q[a] for a in compensator.axes])
    moved = dict(q)
    for a, move in zip([*"XYZ", *compensator.turning], found.moves, strict=True):
        moved[a] += move
    return moved, found


@pytest.mark.parametrize("name", POLES)
def test_the_nominal_machine_has_there_the_pose_that_the_real_one_has(name):
    machine, compensator = compensator_of(name, errors := errors_of(machine_of(CODES[name])))
    where = somewhere(machine, 60)
    reached = 0
    for i in range(60):
        q = row(where, i)
        found, said = corrected(compensator, q)
        real, shown = chain(machine, errors, q, TOOL), chain(machine, None, found, TOOL)
        assert np.linalg.norm(real[0] - shown[0]) < 1e-6
        assert angle(real[1], shown[1]) == pytest.approx(said.direction_left, abs=1e-9)
        assert not said.limited
        if abs(math.sin(q[POLES[name]])) > POLE + 1e-3:
            reached += 1
            assert angle(real[1], chain(machine, None, q, TOOL)[1]) > 1e-6
            assert angle(real[1], shown[1]) < 1e-9
            assert not said.damped
    assert reached > 45


@pytest.mark.parametrize("name", POLES)
def test_a_controller_that_drives_it_to_the_target_reaches_the_targets_pose(name):
    """Command → exact chain → wanted pose; and the command is that of `abbe correct --command`."""
    machine, compensator = compensator_of(name, errors := errors_of(machine_of(CODES[name])))
    where = somewhere(machine, 20, seed=3)
    wanted = {a: np.where(np.abs(v) < 0.2, 0.5, v) if a in "AB" else v for a, v in where.items()}
    command = command_of(model_of(machine, errors), Conditions.at(wanted, tool=TOOL))
    for i in range(20):
        target = row(wanted, i)
        q = dict(target)
        for _ in range(6):  # what a position loop does
            shown, _said = corrected(compensator, q)
            q = {a: q[a] + target[a] - shown[a] for a in q}
        point, direction = chain(machine, errors, q, TOOL)
        to, pointing = chain(machine, None, target, TOOL)
        assert np.linalg.norm(point - to) < 1e-6
        assert angle(direction, pointing) < 1e-9
        for a, v in row(command.conditions.positions, i).items():
            assert q[a] == pytest.approx(v, abs=2e-6 if a in "XYZ" else 2e-9)


def test_through_a_pole_the_turn_is_bounded_smooth_and_reported():
    machine = machine_of(CODES["head-head"])
    errors = {a: np.zeros((6, 7)) for a in machine.structure.axes}
    errors["X"][3] = 5e-5  # everything behind X leans by 50 µrad about X, across B's reach
    _, compensator = compensator_of("head-head", errors)
    need = 5e-5 * math.cos(0.4)
    turns, lefts = [], []
    for b in np.linspace(-0.1, 0.1, 2001):
        q = {"X": 100.0, "Y": 0.0, "Z": -50.0, "C": 0.4, "B": float(b)}
        found, said = corrected(compensator, q)
        turns.append(found["C"] - 0.4)
        lefts.append(said.direction_left)
        assert said.damped == (said.direction_left > 1e-9)
        if abs(math.sin(b)) > POLE + 1e-4:
            assert abs(turns[-1]) == pytest.approx(need / abs(math.tan(b)), rel=1e-3)
            assert not said.damped
        point, _ = chain(machine, errors, q, TOOL)
        assert np.linalg.norm(point - chain(machine, None, found, TOOL)[0]) < 1e-6
    assert np.abs(turns).max() < 26.5 * need
    assert np.abs(turns).max() < MOST_TURN
    assert np.abs(np.diff(turns)).max() < 1e-5
    assert turns[1000] == pytest.approx(0.0, abs=5e-6)  # of 1.2e-3 beside it
    assert lefts[1000] == pytest.approx(need, rel=1e-3)


def test_what_no_axis_can_turn_back_is_reported_with_its_size():
    machine = machine_of(CODES["B head"])
    errors = {a: np.zeros((6, 7)) for a in machine.structure.axes}
    errors["Y"][3], errors["Y"][4] = 3e-5, 7e-5  # about X: no axis; about Y: B
    _, compensator = compensator_of("B head", errors)
    q = {"X": 100.0, "Y": 0.0, "Z": -50.0, "B": 0.0}
    found, said = corrected(compensator, q)
    assert found["B"] == pytest.approx(7e-5, abs=1e-9)
    assert said.direction_left == pytest.approx(3e-5, rel=1e-6)
    assert not said.damped
    point, _ = chain(machine, errors, q, TOOL)
    assert np.linalg.norm(point - chain(machine, None, found, TOOL)[0]) < 1e-6


def test_a_table_that_turns_the_part_about_the_tool_is_read_at_its_angle():
    machine = machine_of(CODES["C table"])
    errors = {a: np.zeros((6, 7)) for a in machine.structure.axes}
    errors["C"][5] = 8e-5
    _, compensator = compensator_of("C table", errors)
    q = row(somewhere(machine, 1), 0)
    found, said = corrected(compensator, q)
    assert found["C"] == pytest.approx(q["C"] + 8e-5, abs=1e-12)
    for a in "XYZ":
        assert found[a] == pytest.approx(q[a], abs=1e-8)
    assert said.spin_left < 1e-9


def test_an_axis_that_is_not_corrected_stays_and_the_point_is_right_all_the_same():
    machine = machine_of(CODES["head-head"])
    errors = errors_of(machine)
    _, compensator = compensator_of("head-head", errors, turning=("B",))
    q = row(somewhere(machine, 1), 0)
    found, said = corrected(compensator, q)
    assert found["C"] == q["C"]
    real, shown = chain(machine, errors, q, TOOL), chain(machine, None, found, TOOL)
    assert np.linalg.norm(real[0] - shown[0]) < 1e-6
    assert angle(real[1], shown[1]) == pytest.approx(said.direction_left, abs=1e-9)
    assert said.direction_left > 1e-6


def test_a_turn_that_is_too_far_is_held_and_reported():
    machine = machine_of(CODES["B head"])
    errors = {a: np.zeros((6, 7)) for a in machine.structure.axes}
    errors["Y"][4] = 0.02
    _, compensator = compensator_of("B head", errors)
    found, said = corrected(compensator, {"X": 100.0, "Y": 0.0, "Z": -50.0, "B": 0.1})
    assert found["B"] == pytest.approx(0.1 + MOST_TURN)
    assert said.limited
    assert said.direction_left == pytest.approx(0.02 - MOST_TURN, rel=1e-3)


def test_only_rotary_axes_can_turn():
    machine = machine_of(CODES["B head"])
    model = model_of(machine, errors_of(machine))
    with pytest.raises(InputError, match="no rotary axis"):
        Compensator(model, turning=("X",))
    with pytest.raises(InputError, match="no rotary axis is corrected"):
        Compensator(model).pose([0.0] * 4)
