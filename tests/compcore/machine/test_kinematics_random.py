"""Any machine that ISO/TR 16907 can write down: random structures against exact transformations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from abbe.compcore.effects import make_effect
from abbe.compcore.effects.base import FUNCTIONAL_POINT, SPINDLE, WORKPIECE, ErrorMotion
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain, exact, first_order
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from tests.support.compcore.homogeneous import HomogeneousMachine, Joint

LETTERS = "XYZABC"
SMALL = st.floats(-1.0, 1.0)


@st.composite
def directions(draw):
    v = np.array([draw(st.floats(-1.0, 1.0)) for _ in range(3)])
    length = np.linalg.norm(v)
    return tuple(v / length) if length > 0.1 else (0.0, 0.6, 0.8)


@st.composite
def worlds(draw):
    """A machine of compcore's, the same as homogeneous transformations, and a pose with errors."""
    names = draw(
        st.lists(
            st.sampled_from(["X", "Y", "Z", "U", "V", "W", "A", "B", "C", "C2"]),
            min_size=1,
            max_size=6,
            unique=True,
        )
    )
    cut = draw(st.integers(0, len(names)))
    spindle = draw(st.sampled_from([None, "A1", "B1", "C1"]))
    axes, joints, acts = {}, {}, {}
    for name in names:
        rotary = name[0] in "ABC"
        nominal = np.eye(3)["XYZ".index({"U": "X", "V": "Y", "W": "Z", "A": "X", "B": "Y",
            "C": "Z"}.get(name[0], name[0]))]  # fmt: skip
        direction = draw(st.one_of(st.just(tuple(nominal)), directions()))
        point = tuple(draw(st.floats(-400.0, 400.0)) for _ in range(3))
        stated = None if rotary else draw(st.sampled_from([None, "before", "after"]))
        axes[name] = Axis(
            name,
            (-7.0, 7.0) if rotary else (-500.0, 500.0),
            direction=direction,
            error_acts=stated,
            **({"location": point} if rotary else {"rotation_point": point}),
        )
        joints[name] = Joint(name, rotary, direction, point)
        if stated:
            acts[name] = stated
    structure = Structure(tuple(names[:cut]), tuple(names[cut:]), spindle)
    machine = Machine("random", structure, axes)
    turns = {"A1": (1.0, 0.0, 0.0), "B1": (0.0, 1.0, 0.0), "C1": (0.0, 0.0, 1.0)}
    truth = HomogeneousMachine(
        [joints[n] for n in names[:cut]],
        [joints[n] for n in names[cut:]],
        turns.get(spindle or ""),
        acts,
    )
    position = {
        n: draw(st.floats(-3.2, 3.2) if n[0] in "ABC" else st.floats(-500.0, 500.0)) for n in names
    }
    tool = tuple(draw(st.floats(-200.0, 200.0)) for _ in range(3))
    angle = draw(st.floats(-3.2, 3.2))
    places = [*names, "workpiece", "spindle"]
    errors = {p: np.array([draw(SMALL) for _ in range(6)]) * 1e-4 for p in places}
    return machine, truth, position, tool, angle, errors


def conditions(position, tool, angle) -> Conditions:
    return Conditions(
        positions={a: np.array([q]) for a, q in position.items()},
        tool=np.array([tool]),
        spindle_angle=np.array([angle]),
    )


def motions(errors):
    place = {"workpiece": WORKPIECE, "spindle": SPINDLE}
    return {
        ErrorMotion(place.get(p, p), letter): np.array([six[k]])
        for p, six in errors.items()
        for k, letter in enumerate(LETTERS)
    }


@given(worlds())
def test_nominal_chain(world):
    machine, truth, position, tool, angle, _ = world
    chain = Chain(machine, conditions(position, tool, angle))
    nominal = truth.frame(position, tool, {}, angle if machine.structure.spindle else 0.0)
    np.testing.assert_allclose(chain.point[0], nominal[:3, 3], atol=1e-9)
    bed = truth.table(position)
    vector = np.array([[1.0, 2.0, 3.0]])
    np.testing.assert_allclose(chain.to_workpiece(vector)[0], bed @ vector[0], atol=1e-12)


@given(worlds())
def test_first_order_error_and_orientation(world):
    """Third order is left: (1e-4)³ · 1 m = 1e-9 mm."""
    machine, truth, position, tool, angle, errors = world
    chain = Chain(machine, conditions(position, tool, angle))
    translation, rotation = first_order(chain, motions(errors))
    angle = angle if machine.structure.spindle else 0.0
    moved, turn = truth.first_order(position, tool, errors, angle)
    np.testing.assert_allclose(translation[0], moved, atol=2e-8)
    np.testing.assert_allclose(rotation[0], turn, atol=1e-10)
    largest = max(np.abs(six).max() for six in errors.values())
    assert np.abs(translation).max() > 0.0 or largest < 1e-10


@given(worlds())
def test_exact_composition_differs_in_second_order_only(world):
    """Angles compose in another order there (Rx·Ry·Rz at each place): products of two angles."""
    machine, truth, position, tool, angle, errors = world
    chain = Chain(machine, conditions(position, tool, angle))
    translation, orientation = exact(chain, motions(errors))
    angle = angle if machine.structure.spindle else 0.0
    moved, rotation = truth.error(position, tool, errors, angle)
    total = 1e-4 * len(errors)
    np.testing.assert_allclose(translation[0], moved, atol=4000.0 * total**2)
    np.testing.assert_allclose(orientation[0], rotation, atol=3.0 * total**2)


@given(worlds(), st.integers(0, 5), st.integers(0, 7))
def test_one_error_motion_at_a_time(world, k, which):
    """Each error motion's influence alone, so that no two mistakes can cancel."""
    machine, truth, position, tool, angle, errors = world
    chain = Chain(machine, conditions(position, tool, angle))
    angle = angle if machine.structure.spindle else 0.0
    place = {"workpiece": WORKPIECE, "spindle": SPINDLE}
    name = list(errors)[which % len(errors)]
    one = np.zeros(6)
    one[k] = 1e-5
    moved, turn = truth.first_order(position, tool, {name: one}, angle)
    translation, rotation = chain.influence(ErrorMotion(place.get(name, name), LETTERS[k]))
    np.testing.assert_allclose(1e-5 * translation[0], moved, atol=1e-10)
    np.testing.assert_allclose(1e-5 * rotation[0], turn, atol=1e-14)


@given(worlds())
def test_a_shift_of_the_functional_point_is_in_machine_axes(world):
    machine, _, position, tool, angle, _ = world
    chain = Chain(machine, conditions(position, tool, angle))
    wanted = {"X": 1.0, "Y": 2.0, "Z": 3.0}
    shift = {ErrorMotion(FUNCTIONAL_POINT, k): np.array([v]) for k, v in wanted.items()}
    translation, rotation = first_order(chain, shift)
    np.testing.assert_allclose(translation, [[1.0, 2.0, 3.0]])
    assert not rotation.any()


def five_axes() -> tuple[Machine, HomogeneousMachine]:
    """A trunnion: the table turns about C on A; what `rotary_location` moves is really moved."""
    lines = {
        "A": ((1.0, 0.0, 0.0), (0.0, 150.0, -80.0)),
        "C": ((0.0, 0.0, 1.0), (200.0, 150.0, 0.0)),
    }
    axes = {a: Axis(a, (0.0, 500.0)) for a in "XYZ"}
    axes |= {a: Axis(a, (-3.0, 3.0), location=line[1]) for a, line in lines.items()}
    machine = Machine("trunnion", Structure.parse("w C' A' b Y X Z t"), axes)
    truth = HomogeneousMachine(
        [Joint(a, True, *lines[a]) for a in "CA"],
        [Joint(a, False, np.eye(3)["XYZ".index(a)]) for a in "YXZ"],
    )
    return machine, truth


@given(st.lists(SMALL, min_size=10, max_size=10), st.integers(0, 2**31))
def test_location_errors_of_a_trunnion(values, seed):
    """E_X0C, E_Y0C, E_A0C, E_B0C, E_C0C and E_Y0A, E_Z0A, E_B0A, E_C0A, E_A0A."""
    machine, truth = five_axes()
    rng = np.random.default_rng(seed)
    position = {a: float(rng.uniform(*machine.axis(a).travel)) for a in "XYZAC"}
    tool = rng.uniform(-150, 150, 3)
    names = {"C": "XYABC", "A": "YZBCA"}
    terms, errors = [], {}
    for axis, block in (("C", values[:5]), ("A", values[5:])):
        effect = make_effect("rotary_location", {"axis": axis})
        sized = {f"E_{k}0{axis}": v * (1e-2 if k in "XYZ" else 1e-4)
            for k, v in zip(names[axis], block, strict=True)}  # fmt: skip
        terms.append(Term(effect, {k: Value(v) for k, v in sized.items()}))
        errors[axis] = [sized.get(f"E_{k}0{axis}", 0.0) for k in LETTERS]
    at = conditions(position, tool, 0.0)
    found = Model(machine, tuple(terms)).predict(at)
    moved, turn = truth.first_order(position, tool, errors)
    np.testing.assert_allclose(found.translation[0], moved, atol=1e-8)
    np.testing.assert_allclose(found.rotation[0], turn, atol=1e-11)


def krulewich(x, y, z, e, radius, length, theta, lean):
    """Krulewich's measurement equation for ``w Z' b X Y t``, part on Z, tool on Y stacked on X.

    ``x = X_c + Δx + R·cos θ − x_b`` and so on; e maps Z, X, Y to (δx, δy, δz, εx, εy, εz). Errors
    of Z act on all that stands behind the part, those of X on Y and the tool, those of Y on the
    tool, the spindle's two squarenesses on the tool alone.
    """
    u, v, w = radius * np.cos(theta), radius * np.sin(theta), -length
    dx = dy = dz = 0.0
    for axis, (rx, ry, rz) in {
        "Z": (x + u, y + v, z + w),
        "X": (u, y + v, w),
        "Y": (u, v, w),
    }.items():
        tx, ty, tz, a, b, c = e[axis]
        dx += tx + b * rz - c * ry
        dy += ty + c * rx - a * rz
        dz += tz + a * ry - b * rx
    # a spindle that leans by s_x towards X and s_y towards Y carries its tool along
    dx += lean[0] * w
    dy += lean[1] * w
    dz += -lean[0] * u - lean[1] * v
    return np.array([x + u + dx, y + v + dy, z + w + dz])


@given(st.integers(0, 2**31))
def test_krulewich_s_equations(seed):
    rng = np.random.default_rng(seed)
    axes = {a: Axis(a, (0.0, 500.0)) for a in "XYZ"}
    machine = Machine("LLNL", Structure.parse("w Z' b X Y (C) t"), axes)
    x, y, z = rng.uniform(0.0, 500.0, 3)
    theta, radius, length = rng.uniform(-3, 3), rng.uniform(0, 80), rng.uniform(50, 300)
    sizes = [1e-2] * 3 + [1e-4] * 3
    e = {a: rng.uniform(-1.0, 1.0, 6) * sizes for a in "XYZ"}
    lean = rng.uniform(-1e-4, 1e-4, 2)
    at = Conditions(
        positions={"X": np.array([x]), "Y": np.array([y]), "Z": np.array([z])},
        tool=np.array([[radius, 0.0, -length]]),
        spindle_angle=np.array([theta]),
    )
    terms = []
    for axis, six in e.items():
        for k, letter in enumerate(LETTERS):
            terms.append(
                ("formula", {"channel": f"E_{letter}{axis}", "terms": ["1"]}, "c1", six[k])
            )
    for direction, value in zip("XY", lean, strict=True):
        terms.append(("spindle_squareness", {"direction": direction}, "angle", value))
    model = Model(
        machine,
        tuple(Term(make_effect(kind, keys), {name: Value(v)}) for kind, keys, name, v in terms),
    )
    point = Chain(machine, at).point[0] + model.predict(at).translation[0]
    np.testing.assert_allclose(point, krulewich(x, y, z, e, radius, length, theta, lean), atol=1e-9)
    base = rng.uniform(0.0, 500.0, 3)
    distance = np.linalg.norm(krulewich(x, y, z, e, radius, length, theta, lean) - base)
    assert np.linalg.norm(point - base) == pytest.approx(distance, abs=1e-9)
