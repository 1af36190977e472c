"""Commands of arms, SCARA robots and lathes with C: against chains of 4×4 matrices."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.pose import command_of
from tests.support.compcore.five_axis import angle, chain, errors_of, machine_of, model_of, row

ARM = machine_of(
    "w b C B B2 A B3 A2 t",
    {
        "C": (0.0, 0.0, 0.0),
        "B": (75.0, 0.0, 330.0),
        "B2": (75.0, 0.0, 640.0),
        "A": (75.0, 0.0, 715.0),
        "B3": (395.0, 0.0, 715.0),
        "A2": (395.0, 0.0, 715.0),
    },
)
SCARA = machine_of(
    "w b C C2 Z C3 t", {"C": (0.0, 0.0, 0.0), "C2": (325.0, 0.0, 0.0), "C3": (600.0, 0.0, 0.0)}
)
LATHE = machine_of("w C' b Z X t", {"C": (0.0, 0.0, 0.0)})
FLANGE = (480.0, 10.0, 700.0)
"""mm: the functional point of the arm with all axes at zero."""


TURNS = np.array([1.0, 1.0, 1.0, 50.0, 50.0, 50.0])[:, None]
"""Errors of up to 2 µm and 1.5 mrad of every axis."""


def at(machine, n, seed=2, **ends):
    rng = np.random.default_rng(seed)
    return {a: rng.uniform(*ends[a], n) for a in machine.structure.axes}


def test_an_arm_takes_the_wanted_pose_with_errors_of_all_its_axes():
    errors = {a: TURNS * e for a, e in errors_of(ARM).items()}
    target = at(
        ARM, 40, C=(-1, 1), B=(-0.5, 0.5), B2=(-0.6, 0.6), A=(-1, 1), B3=(0.5, 1.4), A2=(-1.5, 1.5)
    )
    found = command_of(model_of(ARM, errors), Conditions.at(target, tool=FLANGE))
    before = []
    for i in range(40):
        wanted = chain(ARM, None, row(target, i), FLANGE)
        was = chain(ARM, errors, row(target, i), FLANGE)
        now = chain(ARM, errors, row(found.conditions.positions, i), FLANGE)
        before.append(np.linalg.norm(was[0] - wanted[0]))
        # errors add up in nominal axes (docs/conventions.md): 2 µm · 1.5 mrad of each of six axes
        assert np.linalg.norm(now[0] - wanted[0]) < 2e-5
        assert angle(now[1], wanted[1]) < 1e-8
    assert min(before) > 0.1
    assert found.place_left.max() < 1e-6
    assert found.spin_left.max() < 1e-8
    assert not found.damped.any()
    assert not found.limited.any()


def test_a_scara_reaches_the_place_and_leaves_the_lean():
    errors = {a: TURNS * e for a, e in errors_of(SCARA).items()}
    target = at(SCARA, 40, C=(-1, 1), C2=(0.5, 1.5), Z=(-250, 0), C3=(-2, 2))
    tool = (620.0, 0.0, -40.0)
    found = command_of(model_of(SCARA, errors), Conditions.at(target, tool=tool))
    for i in range(40):
        wanted = chain(SCARA, None, row(target, i), tool)
        now = chain(SCARA, errors, row(found.conditions.positions, i), tool)
        assert np.linalg.norm(now[0] - wanted[0]) < 2e-5
        assert angle(now[1], wanted[1]) == pytest.approx(found.direction_left[i], abs=1e-8)
    assert found.direction_left.min() > 1e-6
    assert found.spin_left.max() < 1e-8


def test_an_arm_stretched_out_is_not_bent_for_little():
    """Along itself a stretched arm does not move: that part is left, and said."""
    errors = {a: TURNS * e for a, e in errors_of(SCARA).items()}
    target = {"C": np.zeros(1), "C2": np.zeros(1), "Z": np.full(1, -100.0), "C3": np.zeros(1)}
    tool = (600.0, 0.0, -40.0)
    found = command_of(model_of(SCARA, errors), Conditions.at(target, tool=tool))
    wanted = chain(SCARA, None, row(target, 0), tool)
    now = chain(SCARA, errors, row(found.conditions.positions, 0), tool)
    was = chain(SCARA, errors, row(target, 0), tool)
    assert found.damped[0]
    assert np.linalg.norm(now[0] - wanted[0]) == pytest.approx(found.place_left[0], abs=2e-5)
    assert found.place_left[0] <= np.linalg.norm(was[0] - wanted[0])
    assert max(abs(float(found.conditions.position(a)[0])) for a in ("C", "C2")) < 0.02


def test_a_lathe_takes_y_back_with_its_c_axis():
    errors = errors_of(LATHE)
    target = {
        "C": np.array([0.3, -1.0]),
        "Z": np.array([-50.0, -200.0]),
        "X": np.array([80.0, 30.0]),
    }
    model = model_of(LATHE, errors)
    found = command_of(model, Conditions.at(target, tool=(0.0, 0.0, 0.0)))
    held = command_of(model, Conditions.at(target, tool=(0.0, 0.0, 0.0)), held=["C"])
    for i in range(2):
        wanted = chain(LATHE, None, row(target, i), (0.0, 0.0, 0.0))[0]
        now = chain(LATHE, errors, row(found.conditions.positions, i), (0.0, 0.0, 0.0))[0]
        kept = chain(LATHE, errors, row(held.conditions.positions, i), (0.0, 0.0, 0.0))[0]
        assert np.linalg.norm(now - wanted) < 1e-6
        assert np.linalg.norm(kept - wanted) == pytest.approx(held.place_left[i], abs=1e-7)
        assert held.place_left[i] > 1e-4
        assert held.conditions.position("C")[i] == target["C"][i]


def test_far_turns_are_bounded_and_said():
    errors = errors_of(SCARA)
    errors["C"] = errors["C"] + np.array([0.0, 0, 0, 0, 0, 0.3])[:, None]
    target = at(SCARA, 3, C=(-1, 1), C2=(0.5, 1.5), Z=(-250, 0), C3=(-2, 2))
    found = command_of(model_of(SCARA, errors), Conditions.at(target, tool=(620.0, 0.0, 0.0)))
    assert found.limited.all()
    assert (found.place_left > 1.0).all()
    for a in ("C", "C2", "C3"):
        assert np.abs(found.conditions.position(a) - target[a]).max() <= 0.2 + 1e-12


def test_a_point_is_answered_alike_alone_and_among_others():
    errors = {a: TURNS * e for a, e in errors_of(SCARA).items()}
    target = at(SCARA, 9, C=(-1, 1), C2=(0.0, 1.5), Z=(-250, 0), C3=(-2, 2))
    model, tool = model_of(SCARA, errors), (620.0, 0.0, -40.0)
    every = command_of(model, Conditions.at(target, tool=tool)).conditions
    for i in range(9):
        alone = command_of(model, Conditions.at(row(target, i), tool=tool)).conditions
        for a in target:
            assert alone.position(a)[0] == pytest.approx(every.position(a)[i], abs=1e-11)


def test_nothing_left_that_moves_is_refused():
    mount = machine_of("w b C B t")
    with pytest.raises(InputError, match="no axis that could carry a correction"):
        command_of(
            model_of(mount, errors_of(mount)), Conditions.at({"C": 0.1, "B": 0.2}), held=["B", "C"]
        )
