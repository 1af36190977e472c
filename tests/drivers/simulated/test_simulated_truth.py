"""The exact simulator against closed forms worked out by hand, and Zhang's equations."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from abbe.drivers.simulated.bridge.truth import (
    Array,
    ExactAxis,
    ExactMachine,
    SixErrors,
    parse_structure,
    rigid,
    rotation,
    rotation_vector,
)

BRIDGE = "w b Y X Z t"
AT = {"X": 300.0, "Y": 500.0, "Z": -100.0}
TOOL = np.array([20.0, -30.0, -150.0])


def constant(*six: float) -> SixErrors:
    return lambda state: six


def turned(axis: str, angle: float, v: np.ndarray) -> np.ndarray:
    """Elementary right-handed rotation of v, written out."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = v
    return {
        "x": np.array([x, c * y - s * z, s * y + c * z]),
        "y": np.array([c * x + s * z, y, -s * x + c * z]),
        "z": np.array([c * x - s * y, s * x + c * y, z]),
    }[axis]


@pytest.mark.parametrize("structure", [BRIDGE, "w X' b Y Z t", "w C' B' b Z Y X (C) t", "w b t"])
def test_a_perfect_machine_does_not_err(structure: str) -> None:
    machine = ExactMachine(structure)
    state = {e.name: (0.7 if e.rotary else 123.0) for e in machine.elements}
    assert np.array_equal(machine.error(state, TOOL), np.zeros(3))
    assert np.array_equal(machine.orientation_error(state), np.zeros(3))


def test_the_nominal_point_is_position_plus_tool_whatever_the_side() -> None:
    for structure in (BRIDGE, "w X' b Y Z t", "w Z' Y' X' b t", "w Z' b X Y t"):
        assert ExactMachine(structure).point(AT, TOOL) == pytest.approx(
            np.array([300.0, 500.0, -100.0]) + TOOL, abs=1e-12
        )


def test_a_roll_of_the_first_carriage_turns_all_that_it_carries() -> None:
    # Y rolls by 0.1 rad (far beyond small angles): it carries X's and Z's moves and the tool,
    # and errs after its own move.
    machine = ExactMachine(BRIDGE, {"Y": ExactAxis(error=constant(0, 0, 0, 0, 0.1, 0))})
    arm = np.array([300.0, 0.0, -100.0]) + TOOL
    assert machine.error(AT, TOOL) == pytest.approx(turned("y", 0.1, arm) - arm, abs=1e-12)


def test_abbe_offset_of_the_last_axis() -> None:
    # Z yaws by ε about x; only the tool hangs behind it.
    epsilon = 50e-6
    machine = ExactMachine(BRIDGE, {"Z": ExactAxis(error=constant(0, 0, 0, epsilon, 0, 0))})
    error = machine.error(AT, (0.0, 0.0, -150.0))
    assert error == pytest.approx(
        [0.0, 150.0 * math.sin(epsilon), 150.0 * (1 - math.cos(epsilon))], abs=1e-12
    )


def test_a_workpiece_side_axis_errs_before_its_own_move() -> None:
    yaw = ExactAxis(error=constant(0, 0, 0, 0, 0, 0.01))
    behind = np.array([0.0, 500.0, -100.0]) + TOOL
    own = np.array([300.0, 0.0, 0.0])
    table = ExactMachine("w X' b Y Z t", {"X": yaw}).error(AT, TOOL)
    assert table == pytest.approx(turned("z", 0.01, own + behind) - own - behind, abs=1e-12)
    carriage = ExactMachine("w b X Y Z t", {"X": yaw}).error(AT, TOOL)
    assert carriage == pytest.approx(turned("z", 0.01, behind) - behind, abs=1e-12)


def test_the_rotation_point_moves_the_pivot() -> None:
    axis = ExactAxis(error=constant(0, 0, 0, 0, 0, 0.01), rotation_point=(50.0, 0.0, 0.0))
    arm = np.array([0.0, 500.0, -100.0]) + TOOL - np.array([50.0, 0.0, 0.0])
    error = ExactMachine("w b X Y Z t", {"X": axis}).error(AT, TOOL)
    assert error == pytest.approx(turned("z", 0.01, arm) - arm, abs=1e-12)


@pytest.mark.parametrize(
    ("structure", "mounted"), [(BRIDGE, "X"), ("w X' b Y Z t", "X"), ("w X' b Y Z t", "Y")]
)
def test_a_turned_mount_makes_axes_out_of_square(structure: str, mounted: str) -> None:
    gamma = 1e-3
    machine = ExactMachine(structure, {mounted: ExactAxis(mount=(0, 0, 0, 0, 0, gamma))})

    def at(x: float, y: float) -> np.ndarray:
        return machine.point({"X": x, "Y": y, "Z": 0.0})

    along_x, along_y = at(1.0, 0.0) - at(0.0, 0.0), at(0.0, 1.0) - at(0.0, 0.0)
    # The angle from X to Y is 90° less what X is turned by; in 'w X' b Y', what lies behind
    # the bed is turned by γ, so that Y leans by +γ against X.
    leans = math.pi / 2 - gamma if structure == BRIDGE else math.pi / 2 + gamma
    assert math.acos(float(along_x @ along_y)) == pytest.approx(leans, abs=1e-12)
    assert np.linalg.norm(along_x) == pytest.approx(1.0)


def test_a_scale_expands_from_its_zero() -> None:
    machine = ExactMachine(
        BRIDGE,
        {"X": ExactAxis(actual=lambda s: s["X"] * (1 + 16e-6 * (np.asarray(s["T"]) - 20.0)))},
    )
    error = machine.error(AT | {"T": 22.0}, TOOL)
    assert error == pytest.approx([300.0 * 16e-6 * 2.0, 0.0, 0.0], abs=1e-12)


def test_rotary_axes_turn_about_their_line() -> None:
    # A check by hand: 30° about Z takes (100, 0, 300) to (86.602540378, 50, 300).
    machine = ExactMachine("w b Z C t")
    point = machine.point({"Z": 0.0, "C": math.radians(30)}, (100.0, 0.0, 300.0))
    assert point == pytest.approx([86.602540378, 50.0, 300.0], abs=1e-9)
    # On the workpiece side a positive angle turns the tool the same way relative to the work.
    table = ExactMachine("w C' b Z t", {"C": ExactAxis(location=(10.0, 20.0, 0.0))})
    point = table.point({"Z": 0.0, "C": math.pi / 2}, (15.0, 20.0, 7.0))
    assert point == pytest.approx([10.0, 25.0, 7.0], abs=1e-12)


def test_a_rotary_axis_s_errors_turn_about_its_own_line() -> None:
    tilt = ExactAxis(error=constant(0, 0, 0, 0.01, 0, 0), location=(0.0, 50.0, 80.0))
    machine = ExactMachine("w C' b Z t", {"C": tilt})
    # A point on the pivot does not move; 100 mm above it, it moves by the tilt.
    assert machine.error({"Z": 0.0, "C": 0.0}, (0.0, 50.0, 80.0)) == pytest.approx([0, 0, 0])
    error = machine.error({"Z": 0.0, "C": 0.0}, (0.0, 50.0, 180.0))
    expected = turned("x", 0.01, np.array([0.0, 0.0, 100.0])) - [0, 0, 100]
    assert error == pytest.approx(expected, abs=1e-12)


def test_a_tilted_spindle_carries_its_tool() -> None:
    machine = ExactMachine("w b X Z (C) t", {"(C)": ExactAxis(mount=(0, 0, 0, 0, 1e-3, 0))})
    error = machine.error({"X": 0.0, "Z": 0.0, "(C)": math.pi}, (10.0, 0.0, 0.0))
    # Half a turn puts the tip at x = −10; the tilt about y lifts it by 10 sin ε.
    assert error == pytest.approx([10 * (1 - math.cos(1e-3)), 0.0, 10 * math.sin(1e-3)], abs=1e-12)


vectors = st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3).map(np.array)


@given(vectors)
def test_rotations_are_rotations(vector: np.ndarray) -> None:
    matrix = rotation(vector)
    assert matrix == pytest.approx(Rotation.from_rotvec(vector).as_matrix(), abs=1e-14)
    assert rotation_vector(matrix) == pytest.approx(vector, abs=1e-12)
    assert rotation(np.stack([vector, 2 * vector]))[0] == pytest.approx(matrix, abs=1e-15)


@given(vectors, vectors)
def test_rigid_displacements_keep_distances(six_t: np.ndarray, six_r: np.ndarray) -> None:
    pose = rigid(np.concatenate([six_t, six_r]))
    a, b = np.array([1.0, 2.0, 3.0, 1.0]), np.array([-4.0, 0.5, 2.0, 1.0])
    assert np.linalg.norm(pose @ a - pose @ b) == pytest.approx(np.linalg.norm(a - b))
    assert (pose @ [0, 0, 0, 1])[:3] == pytest.approx(six_t)


def zhang_first_order(
    e: Mapping[str, Array], square: tuple[float, float, float], at: Mapping[str, float], tool: Array
) -> np.ndarray:
    """Zhang et al. (1985), first order, with error motions actual − indicated.

    Their scale errors have the opposite sign; their squarenesses α, β1, β2 tilt X and Z's
    moves only; here the mounts' rotations turn the tool behind them as well.
    """
    xp, yp, zp = tool
    X, Z = at["X"], at["Z"]
    x, y, z = e["X"], e["Y"], e["Z"]
    rx, ry, rz = (x[i] + y[i] + z[i] for i in (3, 4, 5))
    c0, b0, a0 = square  # of X about z, of Z about y, of Z about x
    dx = x[0] + y[0] + z[0] + Z * (x[4] + y[4]) - yp * rz + zp * ry
    dy = x[1] + y[1] + z[1] + X * y[5] - Z * (x[3] + y[3]) + xp * rz - zp * rx
    dz = x[2] + y[2] + z[2] - X * y[4] - xp * ry + yp * rx
    dx += Z * b0 - yp * c0 + zp * b0
    dy += X * c0 - Z * a0 + xp * c0 - zp * a0
    dz += -xp * b0 + yp * a0
    return np.array([dx, dy, dz])


@given(st.integers(0, 10_000))
def test_zhang_s_equations_hold_to_first_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    at = {"X": rng.uniform(0, 700), "Y": rng.uniform(0, 900), "Z": rng.uniform(-360, 0)}
    tool = rng.uniform(-150, 150, 3)
    size = np.array([1e-2] * 3 + [1e-4] * 3)
    e = {name: rng.uniform(-1, 1, 6) * size for name in "XYZ"}
    c0, b0, a0 = square = tuple(rng.uniform(-1e-4, 1e-4, 3))

    def second_order(scale: float) -> float:
        def scaled(values: np.ndarray) -> SixErrors:
            return lambda state: values * scale

        mounts = {"X": (0, 0, 0, 0, 0, c0), "Y": (0,) * 6, "Z": (0, 0, 0, a0, b0, 0)}
        axes = {
            name: ExactAxis(scaled(e[name]), mount=[m * scale for m in mounts[name]])
            for name in "XYZ"
        }
        exact = ExactMachine(BRIDGE, axes).error(at, tool)
        return float(np.linalg.norm(exact - scale * zhang_first_order(e, square, at, tool)))

    whole, half = second_order(1.0), second_order(0.5)
    assert whole < 6 * (3e-4) ** 2 * 1000  # pairs of summed angles, a metre of levers
    # What is left falls with the square of the errors: it is of second order, nothing else.
    assert half == pytest.approx(whole / 4, rel=0.02, abs=1e-11)


def test_arrays_broadcast() -> None:
    machine = ExactMachine(
        BRIDGE, {"X": ExactAxis(error=lambda s: np.asarray(s["X"])[..., None] * np.full(6, 1e-7))}
    )
    x = np.linspace(0, 700, 12).reshape(3, 4)
    error = machine.error({"X": x, "Y": 10.0, "Z": -20.0}, TOOL)
    assert error.shape == (3, 4, 3)
    single = machine.error({"X": x[1, 2], "Y": 10.0, "Z": -20.0}, TOOL)
    assert error[1, 2] == pytest.approx(single, abs=1e-15)
    assert np.linalg.norm(single) > 1e-5


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("b X t", "expected"),
        ("w X Y Z", "expected"),
        ("w X b Y t", "prime"),
        ("w b X' t", "prime"),
        ("w b Q t", "'Q' is no axis"),
        ("w b (C t", "no axis"),
        ("w X' b X t", "twice"),
    ],
)
def test_bad_structures_are_refused(code: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        parse_structure(code)


def test_errors_of_axes_that_do_not_exist_are_refused() -> None:
    with pytest.raises(ValueError, match="no axis 'U'"):
        ExactMachine(BRIDGE, {"U": ExactAxis()})
