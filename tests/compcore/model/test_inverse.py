"""Raw → corrected → raw, for corrections far larger than any machine's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from abbe.compcore.effects import Backlash
from abbe.compcore.errors import NotContractionError
from abbe.compcore.files.map_file import load_map
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.structure import Structure
from abbe.compcore.maps.table import AxisTable, CompensationMap
from abbe.compcore.maps.to_model import import_map
from abbe.compcore.model.inverse import invert, invert_model
from abbe.compcore.model.model import Model, Term, Value
from tests.support.compcore.machines import machine

EXAMPLE = Path(__file__).parents[2] / "data" / "bridge-map.txt"
TRAVELS = {"X": (0.0, 700.0), "Y": (0.0, 900.0), "Z": (-360.0, 0.0)}


def random_map(rng, linear_mm, angular_rad, rows=8):
    """Tables with kinks at every row and values up to the given sizes."""
    tables = {}
    for axis, (low, high) in TRAVELS.items():
        at = np.sort(rng.uniform(low, high, rows))
        at[0], at[-1] = low, high
        while np.diff(at).min() < (high - low) / (4 * rows):
            at = np.linspace(low, high, rows)
        values = rng.uniform(-1, 1, (rows, 6)) * ([linear_mm] * 3 + [angular_rad] * 3)
        tables[axis] = AxisTable(axis, tuple(at.tolist()), tuple(map(tuple, values.tolist())))
    return CompensationMap(tables)


def places(rng, n=40):
    """Inside, on faces, edges and corners, and beyond the ends, where tables hold."""
    columns = {}
    for axis, (low, high) in TRAVELS.items():
        inside = rng.uniform(low, high, n)
        ends = rng.choice([low, high, low - 50.0, high + 50.0], n)
        columns[axis] = np.where(rng.random(n) < 0.5, inside, ends)
    return Conditions(columns, tool=rng.uniform(-150, 150, (n, 3)))


def corrected(model, raw):
    return raw.moved(model.axis_error(raw))


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.floats(0.1, 1.0), st.sampled_from(["w b Y X Z t", "w Z' b X Y t"]))
def test_raw_corrected_raw_within_1e_9_mm(seed, size, code):
    rng = np.random.default_rng(seed)
    model = import_map(random_map(rng, 2.0 * size, 2e-3 * size), Structure.parse(code))
    raw = places(rng)
    target = corrected(model, raw)
    back, solved = invert_model(model, target)
    for axis in "XYZ":
        np.testing.assert_allclose(back.position(axis), raw.position(axis), atol=1e-9)
    assert (solved.contraction < 1.0).all()
    again = corrected(model, back)
    for axis in "XYZ":
        np.testing.assert_allclose(again.position(axis), target.position(axis), atol=1e-9)


def test_corrections_of_five_millimetres():
    rng = np.random.default_rng(9)
    model = import_map(random_map(rng, 3.5, 3e-3), Structure.parse("w b Y X Z t"))
    raw = places(rng, 2000)
    error = np.stack(list(model.axis_error(raw).values()), axis=1)
    assert np.linalg.norm(error, axis=1).max() > 5.0
    back, solved = invert_model(model, corrected(model, raw))
    worst = max(np.abs(back.position(a) - raw.position(a)).max() for a in "XYZ")
    assert worst < 1e-9
    assert 0.05 < solved.contraction.max() < 0.6
    assert solved.iterations < 40


def test_the_published_map_needs_three_rounds():
    model = import_map(load_map(EXAMPLE), Structure.parse("w b Y X Z t"))
    raw = Conditions.at({"X": 200.0, "Y": 600.0, "Z": -150.0})
    back, solved = invert_model(model, corrected(model, raw))
    assert [back.position(a)[0] for a in "XYZ"] == pytest.approx([200, 600, -150], abs=1e-10)
    assert solved.iterations <= 3
    assert solved.contraction[0] < 1e-3


def test_one_subtraction_is_not_enough():
    """Why one iterates: subtracting the error at the corrected point is off by slope × error."""
    rng = np.random.default_rng(2)
    model = import_map(random_map(rng, 2.0, 0.0), Structure.parse("w b Y X Z t"))
    raw = Conditions.at({"X": 200.0, "Y": 600.0, "Z": -150.0})
    target = corrected(model, raw)
    error = model.axis_error(target)
    once = max(abs(target.position(a)[0] - error[a][0] - raw.position(a)[0]) for a in "XYZ")
    assert once > 1e-4


@pytest.mark.parametrize("slope", [0.5, -0.5, 0.9, -0.9])
def test_the_contraction_factor_is_the_error_s_slope(slope):
    def error(p):
        return np.column_stack([slope * p[:, 0], np.zeros((len(p), 2))])

    target = np.array([[5.0, 1.0, 2.0], [-3.0, 0.0, 0.0]])
    solved = invert(error, target)
    np.testing.assert_allclose(solved.positions[:, 0] * (1 + slope), target[:, 0], atol=1e-9)
    np.testing.assert_allclose(solved.positions[:, 1:], target[:, 1:])
    np.testing.assert_allclose(solved.contraction, abs(slope), rtol=1e-6)


@pytest.mark.parametrize("slope", [1.0, -1.0, 1.5, -3.0])
def test_a_model_that_is_no_contraction_is_refused(slope):
    def error(p):
        return np.column_stack([slope * p[:, 0] + 0.1, np.zeros((len(p), 2))])

    with pytest.raises(NotContractionError, match=r"at X=5, Y=1, Z=2.*per mm of travel"):
        invert(error, np.array([[5.0, 1.0, 2.0]]))


def test_a_fold_that_iteration_would_not_notice_is_refused():
    """A solution is reached, but the error's slope there is beyond 1: others lie near."""

    def error(p):
        x = p[:, 0]
        return np.column_stack([np.where(x > 0.0, -1.5 * x, 0.0), np.zeros((len(p), 2))])

    with pytest.raises(NotContractionError):
        invert(error, np.array([[0.0, 0.0, 0.0]]))


def test_further_columns_are_held_and_rows_stay_in_place():
    seen = []

    def error(p):
        seen.append(p[:, 3].tolist())
        return np.column_stack([1e-3 * p[:, 3], np.zeros((len(p), 2))])

    target = np.array([[1.0, 2.0, 3.0, 0.5], [4.0, 5.0, 6.0, -0.5]])
    solved = invert(error, target)
    np.testing.assert_allclose(solved.positions[:, 3], [0.5, -0.5])
    np.testing.assert_allclose(solved.positions[:, 0], [1.0 - 0.5e-3, 4.0 + 0.5e-3])
    assert set(map(tuple, seen)) == {(0.5, -0.5)}


def test_no_points_and_no_error():
    assert invert(lambda p: np.zeros((len(p), 3)), np.zeros((0, 3))).positions.shape == (0, 3)
    solved = invert(lambda p: np.zeros((len(p), 3)), np.ones((2, 3)))
    assert solved.iterations == 1
    assert solved.contraction.tolist() == [0.0, 0.0]


def test_approach_directions_are_kept():
    model = Model(machine(), (Term(Backlash(axis="X"), {"b": Value(0.02)}),))
    target = Conditions.at({"X": [10.0, 10.0], "Y": 0.0, "Z": 0.0}, directions={"X": [1.0, -1.0]})
    back, _ = invert_model(model, target)
    np.testing.assert_allclose(back.position("X"), [9.99, 10.01], atol=1e-9)
