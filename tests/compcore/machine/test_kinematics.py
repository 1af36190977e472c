"""The kinematic core against an independent rigid-body machine (4×4 transformations)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from abbe.compcore.effects import ErrorMotion
from abbe.compcore.effects.base import FUNCTIONAL_POINT, SPINDLE, WORKPIECE
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import (
    Chain,
    exact,
    first_order,
    moved_by,
    multiplied,
    rotation_xyz,
)
from abbe.compcore.machine.machine import Axis
from tests.support.compcore.machines import machine, motions
from tests.support.compcore.rigid_body import tool_error, turn

STRUCTURES = [
    "w b Y X Z t",
    "w b X Y Z t",
    "w b X Z Y t",
    "w Z' b X Y t",
    "w X' b Y Z t",
    "w Y' X' b Z t",
    "w X' Y' Z' b t",
    "w b Y X Z W t",
]
FIVE_AXIS = ["w X' b Y Z C B t", "w C' A' b Y X Z t", "w C' X' b Y Z B t", "w A' b X Y Z C t"]


def random_pose(chain, rng, n=6):
    """Positions (mm; rotary rad) and tool offsets (mm) of n poses."""
    axes = chain.structure.axes
    q = {
        a: rng.uniform(-2.5, 2.5, n) if chain.axis(a).rotary else rng.uniform(-500, 500, n)
        for a in axes
    }
    return q, rng.uniform(-200, 200, (n, 3))


def truth(m, q, tool, errors, scale=1.0):
    """The rigid-body machine's translation (n, 3) and orientation (n, 3, 3), in machine axes."""
    s = m.structure
    pivots = {a: m.axes[a].rotation_point for a in s.linear}
    locations = {a: m.axes[a].location for a in s.rotary}
    found = [
        tool_error(
            s.workpiece_side,
            s.tool_side,
            {a: v[i] for a, v in q.items()},
            tool[i],
            {a: e[i] * scale for a, e in errors.items()},
            pivots=pivots,
            locations=locations,
        )
        for i in range(len(tool))
    ]
    translation = np.array([t for t, _ in found])
    orientation = np.array([r for _, r in found])
    for i in range(len(tool)):  # from the workpiece's frame into machine axes
        bed = np.eye(3)
        for a in s.workpiece_side:
            if m.axes[a].rotary:
                bed = bed @ turn(a[0], q[a][i])[:3, :3]
        translation[i] = bed.T @ translation[i]
        orientation[i] = bed.T @ orientation[i] @ bed
    return translation, orientation


def with_pivots(code, rng):
    m = machine(code)
    return machine(
        code,
        **{
            a: Axis(a, m.axes[a].travel, rotation_point=tuple(rng.uniform(-300, 300, 3)))
            for a in m.structure.linear
        },
    )


@pytest.mark.parametrize("code", STRUCTURES)
def test_exact_equals_rigid_body_for_rotations_of_any_size(code):
    rng = np.random.default_rng(7)
    m = with_pivots(code, rng)
    q, tool = random_pose(m, rng)
    errors = {a: np.hstack([np.zeros((6, 3)), rng.uniform(-1, 1, (6, 3))]) for a in q}
    got, orientation = exact(Chain(m, Conditions(q, tool=tool)), motions(errors))
    expected, turned = truth(m, q, tool, errors)
    assert np.abs(expected).min(axis=0).max() > 1.0, "the errors are large"
    np.testing.assert_allclose(got, expected, atol=1e-9)
    np.testing.assert_allclose(orientation, turned, atol=1e-12)


@pytest.mark.parametrize("code", STRUCTURES)
def test_linear_errors_add_up_in_nominal_axes(code):
    rng = np.random.default_rng(8)
    m = machine(code)
    q, tool = random_pose(m, rng)
    errors = {a: np.hstack([rng.uniform(-1, 1, (6, 3)), np.zeros((6, 3))]) for a in q}
    chain = Chain(m, Conditions(q, tool=tool))
    expected = sum(e[:, :3] for e in errors.values())
    np.testing.assert_allclose(exact(chain, motions(errors))[0], expected, atol=1e-12)
    np.testing.assert_allclose(first_order(chain, motions(errors))[0], expected, atol=1e-12)


def orders(differences):
    """log2 of how much each halving of the errors shrinks a difference."""
    return np.log2(np.array(differences[:-1]) / np.array(differences[1:]))


@pytest.mark.parametrize("code", STRUCTURES + FIVE_AXIS)
@pytest.mark.parametrize("pair", ["exact-first", "truth-first", "truth-exact"])
def test_the_forms_differ_in_second_order_only(code, pair):
    rng = np.random.default_rng(11)
    m = with_pivots(code, rng)
    if m.structure.rotary:
        m = machine(
            code,
            **m.axes
            | {
                a: Axis(a, (-3.0, 3.0), location=tuple(rng.uniform(-200, 200, 3)))
                for a in m.structure.rotary
            },
        )
    q, tool = random_pose(m, rng)
    chain = Chain(m, Conditions(q, tool=tool))
    errors = {a: rng.uniform(-1, 1, (6, 6)) * ([5.0] * 3 + [0.02] * 3) for a in q}
    moved, turned = [], []
    for s in 0.5 ** np.arange(5):
        scaled = motions({a: e * s for a, e in errors.items()})
        small, rotation = first_order(chain, scaled)
        full, orientation = exact(chain, scaled)
        true, true_orientation = truth(m, q, tool, errors, s)
        skew = orientation if pair == "exact-first" else true_orientation
        left, right = {
            "exact-first": (full, small),
            "truth-first": (true, small),
            "truth-exact": (true, full),
        }[pair]
        moved.append(np.abs(left - right).max())
        vector = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        turned.append(np.abs(vector - rotation).max())
    np.testing.assert_allclose(orders(moved), 2.0, atol=0.1)
    np.testing.assert_allclose(orders(turned), 2.0, atol=0.1)


def test_thirty_degrees_by_hand():
    chain = Chain(machine(), Conditions.at({"X": 100.0, "Y": 0.0, "Z": 300.0}))
    total, _ = exact(chain, {ErrorMotion("Y", "C"): np.array([np.pi / 6])})
    np.testing.assert_allclose(
        chain.point[0] + total[0], [86.602540378443865, 50.0, 300.0], atol=1e-12
    )


@given(*(st.floats(-3.2, 3.2) for _ in range(3)))
def test_rotations_are_about_the_current_axes_in_the_order_x_y_z(a, b, c):
    got = rotation_xyz(np.array([a]), np.array([b]), np.array([c]))[0]
    expected = turn("A", a) @ turn("B", b) @ turn("C", c)
    np.testing.assert_allclose(got, expected[:3, :3], atol=1e-14)


def test_levers_of_a_mill_by_hand():
    """``w Z' b X Y t``: Z moves the table, the spindle stands on Y, Y on X."""
    chain = Chain(
        machine("w Z' b X Y t"),
        Conditions.at({"X": 10.0, "Y": 200.0, "Z": 3000.0}, tool=(0.1, 0.02, -0.003)),
    )
    np.testing.assert_allclose(chain.lever("Z")[0], (10.1, 200.02, 2999.997))  # its own move too
    np.testing.assert_allclose(chain.lever("X")[0], (0.1, 200.02, -0.003))
    np.testing.assert_allclose(chain.lever("Y")[0], (0.1, 0.02, -0.003))
    np.testing.assert_allclose(chain.point[0], (10.1, 200.02, 2999.997))
    moved, turned = chain.influence(ErrorMotion("Z", "C"))
    np.testing.assert_allclose(moved[0], (-200.02, 10.1, 0.0))
    np.testing.assert_allclose(turned[0], (0.0, 0.0, 1.0))


def test_levers_of_a_bridge_by_hand():
    at = Conditions.at({"X": 10.0, "Y": 200.0, "Z": 3000.0}, tool=(0.1, 0.02, -0.003))
    chain = Chain(machine(), at)
    np.testing.assert_allclose(chain.lever("Y")[0], (10.1, 0.02, 2999.997))
    np.testing.assert_allclose(chain.lever("X")[0], (0.1, 0.02, 2999.997))
    np.testing.assert_allclose(chain.lever("Z")[0], (0.1, 0.02, -0.003))
    np.testing.assert_allclose(chain.lever(SPINDLE)[0], (0.1, 0.02, -0.003))
    np.testing.assert_allclose(chain.lever(WORKPIECE)[0], chain.point[0])


def test_rotation_point_and_error_acts_by_hand():
    at = Conditions.at({"X": 10.0, "Y": 200.0, "Z": 3000.0})
    shifted = machine(Y=Axis("Y", (0.0, 900.0), rotation_point=(1.0, 20.0, 300.0)))
    np.testing.assert_allclose(Chain(shifted, at).lever("Y")[0], (9.0, -20.0, 2700.0))
    before = machine(Y=Axis("Y", (0.0, 900.0), error_acts="before"))
    np.testing.assert_allclose(Chain(before, at).lever("Y")[0], (10.0, 200.0, 3000.0))
    after = machine("w Z' b X Y t", Z=Axis("Z", (0.0, 9000.0), error_acts="after"))
    np.testing.assert_allclose(Chain(after, at).lever("Z")[0], (10.0, 200.0, 0.0))


def test_a_spindles_angle_turns_the_tools_offset():
    c = Conditions(
        {a: np.zeros(1) for a in "XYZ"},
        tool=np.array([[10.0, 0.0, -50.0]]),
        spindle_angle=np.array([np.pi / 2]),
    )
    np.testing.assert_allclose(
        Chain(machine("w b Y X Z (C) t"), c).point[0], (0, 10, -50), atol=1e-12
    )
    np.testing.assert_allclose(Chain(machine("w b Y X Z t"), c).point[0], (10, 0, -50), atol=1e-12)


@pytest.mark.parametrize("code", ["w b Y X Z (C) t", "w C' A' b X Y Z t", "w b C1 B2 B3 t"])
def test_another_tool_on_the_same_machine_is_the_machine_with_that_tool(code):
    owner, rng = machine(code), np.random.default_rng(3)
    at = {a: rng.uniform(-1.0, 1.0, 5) for a in owner.structure.axes}
    angle = rng.uniform(-3.0, 3.0, 5) if owner.structure.spindle else None
    first, second = (rng.uniform(-200.0, 200.0, (5, 3)) for _ in range(2))
    own = Chain(owner, Conditions(at, tool=first, spindle_angle=angle))
    places = [owner.structure.axes[0], SPINDLE, WORKPIECE]
    own_levers = [own.lever(p) for p in places]
    found = own.with_tool(second)
    whole = Chain(owner, Conditions(at, tool=second, spindle_angle=angle))
    for name in ("point", "tool"):
        np.testing.assert_allclose(getattr(found, name), getattr(whole, name), atol=1e-12)
    for place, before in zip(places, own_levers, strict=True):
        np.testing.assert_allclose(found.lever(place), whole.lever(place), atol=1e-12)
        np.testing.assert_array_equal(own.lever(place), before)


def test_an_error_at_the_functional_point_has_no_lever():
    chain = Chain(machine(), Conditions.at({"X": 300.0, "Y": 400.0, "Z": -100.0}))
    only = {ErrorMotion(FUNCTIONAL_POINT, "Y"): np.array([0.004])}
    np.testing.assert_allclose(first_order(chain, only)[0], [[0.0, 0.004, 0.0]])
    np.testing.assert_allclose(exact(chain, only)[0], [[0.0, 0.004, 0.0]])


def test_moves_of_axes_that_a_rotary_axis_carries():
    """Behind a B axis at 90° the Z axis moves along machine X; a C table turns none."""
    head = machine("w b X Y B Z t", B=Axis("B", (-2.0, 2.0)))
    c = Conditions.at({"X": 1.0, "Y": 2.0, "Z": 3.0, "B": np.pi / 2})
    expected = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(Chain(head, c).axis_moves()[0], expected, atol=1e-15)
    table = machine("w C' b X Y Z t", C=Axis("C", (-4.0, 4.0)))
    turned = Chain(table, Conditions.at({"X": 1.0, "Y": 2.0, "Z": 3.0, "C": np.pi / 2}))
    np.testing.assert_allclose(turned.axis_moves()[0], np.eye(3), atol=1e-15)


def test_a_lathe_moves_what_its_axes_can_and_leaves_the_rest():
    chain = Chain(machine("w b Z X t"), Conditions.at({"X": 3.0, "Z": -5.0}))
    np.testing.assert_array_equal(chain.axis_moves()[0], np.eye(3))
    error = np.array([[0.004, -0.003, 0.002]])
    np.testing.assert_array_equal(chain.as_moves(error), [[0.004, 0.0, 0.002]])
    np.testing.assert_array_equal(chain.left_by_moves(error), [[0.0, -0.003, 0.0]])


@pytest.mark.parametrize("code", ["w b X Z t", "w b Y t", "w b C B t", "w b B Z X t", "w b A Y t"])
def test_what_is_left_stands_square_to_every_axis_that_is_there(code):
    rng = np.random.default_rng(3)
    m = machine(code, **{a: Axis(a, (-4.0, 4.0)) for a in "ABC" if a in code})
    where = {a: rng.uniform(-2.0, 2.0, 20) for a in m.structure.axes}
    chain, error = Chain(m, Conditions(where)), rng.normal(size=(20, 3))
    moves, left = chain.as_moves(error), chain.left_by_moves(error)
    total = left.copy()
    for k, letter in enumerate("XYZ"):
        if letter in m.structure.linear:
            way = chain.to_machine_axes(chain.screw(letter)[0])
            np.testing.assert_allclose(np.einsum("ni,ni->n", way, left), 0.0, atol=1e-12)
            total += moves[:, k : k + 1] * way
        else:
            assert not moves[:, k].any()
    np.testing.assert_allclose(total, error, atol=1e-12)
    np.testing.assert_allclose(np.abs(np.linalg.det(chain.axis_moves())), 1.0, atol=1e-9)


def test_unknown_places_are_refused():
    chain = Chain(machine(), Conditions.at({"X": 0.0, "Y": 0.0, "Z": 0.0}))
    for ask in (chain.lever, lambda place: chain.influence(ErrorMotion(place, "A"))):
        with pytest.raises(InputError, match="no such place: found 'W', expected one of workpiece"):
            ask("W")


def test_products_written_out_are_numpys():
    rng = np.random.default_rng(3)
    a, b, v = rng.normal(size=(5, 3, 3)), rng.normal(size=(5, 3, 3)), rng.normal(size=(5, 3))
    np.testing.assert_allclose(multiplied(a, b), a @ b, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(moved_by(a, v), (a @ v[:, :, None])[:, :, 0], rtol=1e-14, atol=1e-14)
