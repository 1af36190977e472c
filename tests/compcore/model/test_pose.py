"""Commands that hold the tool's direction: against chains of 4×4 matrices written out apart."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import root

from abbe.compcore.errors import NotContractionError
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


@pytest.mark.parametrize("name", ["head-head", "table-table", "mixed"])
def test_the_commanded_machine_takes_the_wanted_pose(name):
    machine = machine_of(CODES[name])
    errors = errors_of(machine)
    target = somewhere(machine, 60)
    found = command_of(model_of(machine, errors), Conditions.at(target, tool=TOOL))
    pole = {"head-head": "B", "table-table": "A", "mixed": "B"}[name]
    reached = 0
    for i in range(60):
        wanted = chain(machine, None, row(target, i), TOOL)
        before = chain(machine, errors, row(target, i), TOOL)
        after = chain(machine, errors, row(found.conditions.positions, i), TOOL)
        assert np.linalg.norm(after[0] - wanted[0]) < 1e-6
        assert angle(after[1], wanted[1]) == pytest.approx(found.direction_left[i], abs=1e-9)
        if abs(math.sin(target[pole][i])) > POLE:
            reached += 1
            assert angle(before[1], wanted[1]) > 1e-6
            assert angle(after[1], wanted[1]) < 1e-9
            assert not found.damped[i]
    assert reached > 45


@pytest.mark.parametrize("name", ["head-head", "table-table", "mixed"])
def test_it_is_the_exact_inverse(name):
    """SciPy solves the five equations of the chain written out apart for the five axes."""
    machine = machine_of(CODES[name])
    errors = errors_of(machine)
    target = somewhere(machine, 12, seed=8)
    target = {a: np.where(np.abs(q) < 0.3, 0.5, q) if a in "AB" else q for a, q in target.items()}
    found = command_of(model_of(machine, errors), Conditions.at(target, tool=TOOL))
    axes = list(machine.structure.axes)
    for i in range(12):
        point, direction = chain(machine, None, row(target, i), TOOL)
        across = np.linalg.svd(direction[None, :])[2][1:]

        def off(q, point=point, across=across):
            p, d = chain(machine, errors, dict(zip(axes, q, strict=True)), TOOL)
            return np.concatenate([p - point, 100.0 * across @ d])

        start = [row(target, i)[a] for a in axes]
        exact = root(off, start, method="hybr", tol=1e-14).x
        for a, q in zip(axes, exact, strict=True):
            tolerance = 1e-6 if a in "XYZ" else 1e-9
            assert found.conditions.positions[a][i] == pytest.approx(q, abs=tolerance), a


def test_at_the_pole_the_turn_is_bounded_smooth_and_reported():
    machine = machine_of(CODES["head-head"])
    errors = {a: np.zeros((6, 7)) for a in machine.structure.axes}
    errors["X"][3] = 5e-5  # everything behind X leans by 50 µrad about X, across B's reach
    n = 2001
    b = np.linspace(-0.1, 0.1, n)
    still = {a: np.full(n, v) for a, v in {"X": 100.0, "Y": 0.0, "Z": -50.0, "C": 0.4}.items()}
    target = {**still, "B": b}
    found = command_of(model_of(machine, errors), Conditions.at(target, tool=TOOL))
    turned = found.conditions.positions["C"] - 0.4
    need = 5e-5 * math.cos(0.4)  # across the plane of B; C moves the tool there by sin B
    away = np.abs(np.sin(b)) >= POLE
    np.testing.assert_allclose(np.abs(turned[away]), need / np.abs(np.tan(b[away])), rtol=1e-3)
    assert np.abs(turned).max() < 26.5 * need  # 1/σ up to 20, a little more where damping sets in
    assert np.abs(turned).max() < MOST_TURN
    # 0.1 mrad of B from one point to the next: C never jumps
    assert np.abs(np.diff(turned)).max() < 1e-5
    assert turned[n // 2] == pytest.approx(0.0, abs=1e-9)
    assert found.direction_left[n // 2] == pytest.approx(need, rel=1e-3)
    assert found.damped[n // 2]
    assert not found.damped[away].any()
    assert found.direction_left[away].max() < 1e-9
    for i in range(0, n, 100):
        wanted = chain(machine, None, row(target, i), TOOL)
        after = chain(machine, errors, row(found.conditions.positions, i), TOOL)
        assert np.linalg.norm(after[0] - wanted[0]) < 1e-6
        assert angle(after[1], wanted[1]) == pytest.approx(found.direction_left[i], abs=1e-9)


def test_a_table_that_only_turns_the_part_about_the_tool_is_brought_to_its_angle():
    """R-POS: nothing but C can undo its own positioning error; the point goes along."""
    machine = machine_of(CODES["C table"])
    errors = {a: np.zeros((6, 7)) for a in machine.structure.axes}
    errors["C"][5] = 8e-5
    target = somewhere(machine, 5)
    found = command_of(model_of(machine, errors), Conditions.at(target, tool=TOOL))
    np.testing.assert_allclose(found.conditions.positions["C"], target["C"] - 8e-5, atol=1e-12)
    for a in "XYZ":
        np.testing.assert_allclose(found.conditions.positions[a], target[a], atol=1e-8)
    held = command_of(model_of(machine, errors), Conditions.at(target, tool=TOOL), held=["C"])
    np.testing.assert_array_equal(held.conditions.positions["C"], target["C"])
    np.testing.assert_allclose(held.spin_left, 8e-5, rtol=1e-6)


def test_what_no_axis_can_do_is_left_and_reported_with_its_size():
    machine = machine_of(CODES["B head"])
    errors = {a: np.zeros((6, 7)) for a in machine.structure.axes}
    errors["Y"][3], errors["Y"][4] = 3e-5, 7e-5  # about X: no axis; about Y: B
    target = {"X": [100.0], "Y": [0.0], "Z": [-50.0], "B": [0.0]}
    found = command_of(model_of(machine, errors), Conditions.at(target, tool=TOOL))
    assert found.conditions.positions["B"][0] == pytest.approx(-7e-5, abs=1e-9)
    assert found.direction_left[0] == pytest.approx(3e-5, rel=1e-6)
    assert not found.damped[0]
    q = row(found.conditions.positions, 0)
    wanted = chain(machine, None, {a: v[0] for a, v in target.items()}, TOOL)
    assert np.linalg.norm(chain(machine, errors, q, TOOL)[0] - wanted[0]) < 1e-6


def test_no_axis_is_sent_out_of_its_travel_or_farther_than_allowed():
    machine = machine_of(CODES["B head"])
    errors = {a: np.zeros((6, 7)) for a in machine.structure.axes}
    errors["Y"][4] = 7e-5
    model = model_of(machine, errors)
    at_end = {"X": [1.0], "Y": [0.0], "Z": [-50.0], "B": [machine.axes["B"].travel[0]]}
    found = command_of(model, Conditions.at(at_end, tool=TOOL))
    assert found.conditions.positions["B"][0] == machine.axes["B"].travel[0]
    assert found.limited[0]
    assert found.direction_left[0] == pytest.approx(7e-5, rel=1e-6)
    middle = {**at_end, "B": [0.5]}
    found = command_of(model, Conditions.at(middle, tool=TOOL), most=2e-5)
    assert found.conditions.positions["B"][0] == pytest.approx(0.5 - 2e-5, abs=1e-15)
    assert found.limited[0]
    assert found.direction_left[0] == pytest.approx(5e-5, rel=1e-6)


@pytest.mark.parametrize("composition", ["first-order", "exact"])
def test_without_rotary_axes_it_is_the_command_of_ever(composition):
    from abbe.compcore.model.inverse import invert_model

    machine = machine_of("w X' b Y Z t")
    model = model_of(machine, errors_of(machine), composition)
    at = Conditions.at(somewhere(machine, 20), tool=TOOL)
    one, _ = invert_model(model, at)
    two = command_of(model, at)
    for a in "XYZ":
        np.testing.assert_allclose(two.conditions.positions[a], one.positions[a], atol=1e-8)
    assert two.direction_left.max() > 1e-5


def test_a_field_that_changes_too_fast_is_refused():
    machine = machine_of(CODES["B head"])
    errors = {a: np.zeros((6, 7)) for a in machine.structure.axes}
    errors["Y"][1] = 3.0 * np.where(np.arange(7) % 2, -100.0, 100.0)
    with pytest.raises(NotContractionError, match="too fast"):
        command_of(model_of(machine, errors), Conditions.at(somewhere(machine, 3)))
