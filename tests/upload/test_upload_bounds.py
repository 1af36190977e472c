"""Bounds of tables and the check of the effect, against values worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.table import Table, move
from abbe.daemon.upload.checks.bounds import (
    Extent,
    Limits,
    OutOfBoundsError,
    check,
    extent,
    largest_change,
    largest_correction,
)
from abbe.daemon.upload.checks.shown_correction import Expectation
from abbe.drivers.stores.base import ShownCorrection
from tests.support.daemon.upload_cases import TRAVELS
from tests.support.daemon.upload_cases import model as mill

MODEL = mill(0.0)
NO_TOOL = (0.0, 0.0, 0.0)


def table(axis: str, component: str, nodes: list[float], up: list[float], down=None, place=None):
    output = move(component) if place is None else ErrorMotion(place, component)
    back = None if down is None else np.array(down)
    return Table(output, (axis,), (np.array(nodes),), np.array(up), back)


def test_entries_slopes_and_corrections():
    x = table("X", "X", [0.0, 100.0, 500.0], [0.0, 0.010, -0.002], [0.003, 0.013, 0.001])
    y = table("Y", "X", [0.0, 400.0], [0.0, -0.005])
    z = table("Z", "Y", [-300.0, 0.0], [0.006, 0.0])
    found = extent([x, y, z], MODEL, NO_TOOL)
    assert found.entry_um == pytest.approx(13.0)
    assert found.slope == pytest.approx(0.1)
    # the largest of X by X and by Y add up, whatever their signs; Y by Z is perpendicular
    assert found.correction_um == pytest.approx(np.hypot(18.0, 6.0))
    assert found.entry_urad == 0.0


def test_a_slope_out_of_bounds_says_what_it_is_of_the_way():
    # 12.5 µm over 1 mm: a scale that is 1.25 % wrong
    found = extent([table("X", "X", [0.0, 2.0], [0.0, 0.025])], MODEL, NO_TOOL)
    with pytest.raises(OutOfBoundsError, match=r"12\.5 µm/mm; .* allows 5 µm/mm: 1\.25 % of"):
        check(found, None, Limits(100.0, None, 5.0, 100.0, 100.0))


def test_a_product_counts_with_the_end_of_its_lever():
    """20 µrad of Y at its end; Z counts from −100, so its lever reaches 200 mm down to −300."""
    product = replace(table("Y", "X", [0.0, 400.0], [0.0, 20e-6]), lever=("Z", -100.0))
    found = extent([product], MODEL, NO_TOOL)
    assert found.entry_um == pytest.approx(4.0)
    assert found.entry_urad == 0.0
    assert found.correction_um == pytest.approx(4.0)
    # along Z 20 nm a mm; along Y 4 µm over 400 mm
    assert found.slope == pytest.approx(0.02)
    shifted = replace(product, lever=("Z", -200.0))
    assert largest_change([product], [shifted], MODEL, NO_TOOL) == pytest.approx(20e-6 * 100.0)
    expected = Expectation([product], MODEL, NO_TOOL)
    assert not expected.comparable(ShownCorrection({"Y": 400.0}, {"X": 0.0}))
    there = ShownCorrection({"Y": 400.0, "Z": -300.0}, {"X": 0.004})
    assert expected.comparable(there)
    assert expected.at(there)["X"] == pytest.approx((0.004, 0.004))


def test_an_angle_counts_with_its_longest_lever():
    """Pitch of Y, 20 µrad, on a machine `w b Y X Z t`: Z hangs 300 mm below, the tool 100 more."""
    structure = Structure.parse("w b Y X Z t")
    model = Model(Machine("cmm", structure, {a: Axis(a, r) for a, r in TRAVELS.items()}), ())
    pitch = table("Y", "A", [0.0, 400.0], [0.0, 20e-6], place="Y")
    found = extent([pitch], model, (0.0, 0.0, -100.0))
    assert found.entry_urad == pytest.approx(20.0)
    assert found.correction_um == pytest.approx(20e-6 * 400.0 * 1e3, rel=1e-6)


def test_the_bound_is_never_below_what_is_found_anywhere():
    structure = Structure.parse("w X' b Y Z t")
    model = Model(Machine("mill", structure, {a: Axis(a, r) for a, r in TRAVELS.items()}), ())
    rng = np.random.default_rng(3)
    tables = []
    for axis in "XYZ":
        nodes = list(np.linspace(*TRAVELS[axis], 9))
        for component in "XYZABC":
            size = 5e-3 if component in "XYZ" else 2e-5
            ways = [list(size * rng.normal(size=9)) for _ in range(2)]
            tables.append(table(axis, component, nodes, *ways, place=axis))
    tool = (10.0, -20.0, -150.0)
    bound = largest_correction(tables, model, tool)
    where = {a: rng.uniform(*TRAVELS[a], 4000) for a in "XYZ"}
    field = ErrorField(model, SlowState(tool=tool))
    worst = 0.0
    for _ in range(8):
        ways = {a: rng.choice([-1.0, 1.0], 4000) for a in "XYZ"}
        worst = max(worst, np.linalg.norm(field.removed(tables, where, ways), axis=1).max())
    assert worst <= bound < 4.0 * worst


def _with_axes(code: str, **travels: tuple[float, float]) -> Model:
    structure = Structure.parse(code)
    axes = {a: Axis(a, travels[a]) for a in structure.axes}
    return Model(Machine("m", structure, axes), ())


@pytest.mark.parametrize("place", [None, "C"])
def test_the_turn_of_a_table_counts_where_the_tip_is_farthest_from_its_axis(place: str | None):
    """100 µrad; the tip stands at most 500 mm aside and 100 mm across: 51.0 µm."""
    model = _with_axes(
        "w C' b X Y Z t", X=(-500.0, 300.0), Y=(-100.0, 50.0), Z=(0.0, 300.0), C=(-3.0, 3.0)
    )
    turned = table("C", "C", [-3.0, 0.0, 3.0], [0.0, 100e-6, 0.0], place=place)
    found = extent([turned], model, NO_TOOL)
    assert found.entry_urad == pytest.approx(100.0)
    assert 50.99 <= found.correction_um < 1.04 * 51.0
    half = table("C", "C", [-3.0, 0.0, 3.0], [0.0, 50e-6, 0.0], place=place)
    assert 25.49 <= 1e3 * largest_change([turned], [half], model, NO_TOOL) < 1.04 * 25.5


def test_the_turns_of_an_arm_count_by_its_reach():
    """Two joints, no X and no Y: links of 300 and 250 mm; 0.1 mrad of the first is 55 µm."""
    structure = Structure.parse("w b C1 C2 Z t")
    travels = {"C1": (-2.0, 2.0), "C2": (-2.3, 2.5), "Z": (-200.0, 0.0)}
    links = {"C1": (0.0, 0.0, 0.0), "C2": (300.0, 0.0, 0.0)}
    machine = Machine(
        "s",
        structure,
        {
            a: Axis(a, travel, location=links.get(a, (0.0, 0.0, 0.0)))
            for a, travel in travels.items()
        },
    )
    first = table("C1", "C", [-2.0, 0.0, 2.0], [0.0, 100e-6, 0.0], place="C1")
    tool = (550.0, 0.0, 0.0)  # from the origin, which is on the first axis
    found = extent([first], Model(machine, ()), tool)
    assert found.entry_urad == pytest.approx(100.0)
    assert 55.0 <= found.correction_um < 1.25 * 55.0


def test_changes_are_taken_between_the_points_of_both():
    old = table("X", "X", [0.0, 500.0], [0.0, 0.0])
    new = table("X", "X", [0.0, 250.0, 500.0], [0.0, 0.004, 0.0])
    assert largest_change([new], [old], MODEL, NO_TOOL) == pytest.approx(0.004)
    assert largest_change([old], [new], MODEL, NO_TOOL) == pytest.approx(0.004)
    assert largest_change([new], [new], MODEL, NO_TOOL) == pytest.approx(0.0, abs=1e-15)
    assert largest_change([], [new], MODEL, NO_TOOL) == pytest.approx(0.004)


def test_angles_need_a_bound_of_their_own():
    limits = Limits(10.0, None, 5.0, 20.0, 5.0)
    check(Extent(1.0, 0.0, 1.0, 1.0), 1.0, limits)
    with pytest.raises(OutOfBoundsError, match="upload.max_entry_urad"):
        check(Extent(1.0, 3.0, 1.0, 1.0), 1.0, limits)
    for wrong in (Extent(np.nan, 0.0, 1.0, 1.0), Extent(1.0, 0.0, 1.0, np.inf)):
        with pytest.raises(OutOfBoundsError):
            check(wrong, 1.0, limits)


def test_a_setpoint_is_shifted_against_the_error_and_a_reading_with_it():
    x = table("X", "X", [0.0, 500.0], [0.0, 0.010], [0.004, 0.014])
    at = {"X": 250.0, "Y": 0.0, "Z": 0.0}
    shown = dict.fromkeys("XYZ", 0.0)
    expected = Expectation([x], MODEL, NO_TOOL)
    assert expected.at(ShownCorrection(at, shown, {"X": 1}))["X"] == pytest.approx((-0.005, -0.005))
    assert expected.at(ShownCorrection(at, shown, {"X": -1}))["X"] == pytest.approx(
        (-0.009, -0.009)
    )
    # the direction is not known: either way
    assert expected.at(ShownCorrection(at, shown, {}))["X"] == pytest.approx((-0.009, -0.005))
    reads = Expectation([x], MODEL, NO_TOOL, adds_error=True)
    assert reads.at(ShownCorrection(at, shown, {"X": 1}))["X"] == pytest.approx((0.005, 0.005))
    assert not expected.comparable(ShownCorrection({"Y": 0.0}, shown))


def test_a_table_of_a_rotary_axis_turns_it_and_moves_nothing_else():
    """Of a control whose tables move axes; one that has all error motions reckons its levers."""
    model = _with_axes(
        "w C' b X Y Z t", X=(-500.0, 300.0), Y=(-100.0, 50.0), Z=(0.0, 300.0), C=(-3.0, 3.0)
    )
    x = table("X", "X", [-500.0, 300.0], [0.004, 0.004])
    turned = table("C", "C", [-3.0, 0.0, 3.0], [0.0, 100e-6, 0.0], place="C")
    at = {"X": 200.0, "Y": 0.0, "Z": 0.0, "C": 0.0}
    shown = ShownCorrection(at, dict.fromkeys(at, 0.0))
    moves = {k: v[0] for k, v in Expectation([x, turned], model, NO_TOOL).at(shown).items()}
    assert moves == pytest.approx({"X": -0.004, "Y": 0.0, "Z": 0.0, "C": -100e-6})
    own = table("X", "X", [-500.0, 300.0], [0.004, 0.004], place="X")
    levers = {k: v[0] for k, v in Expectation([own, turned], model, NO_TOOL).at(shown).items()}
    # 200 mm from the table's middle 0.1 mrad is 20 µm
    assert abs(levers["Y"]) == pytest.approx(0.020, abs=1e-6)
    assert levers["C"] == 0.0
