from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline
from scipy.special import eval_legendre

from abbe.compcore.effects.shapes import Shape
from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Axis

AXIS = Axis("X", (-120.0, 700.0))
INSIDE = np.concatenate([np.linspace(-120.0, 700.0, 83), [-120.0, 0.0, 699.999999, 700.0]])
OUTSIDE = np.array([-1e4, -121.0, 701.0, 1e4])
CODES = [
    "constant",
    "polynomial:0",
    "polynomial:5",
    "spline:1",
    "spline:3",
    "spline:8",
    "spline:40",
]


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 8, 17, 200])
def test_splines_against_scipy(count):
    degree = min(3, count - 1)
    inner = np.linspace(*AXIS.travel, count - degree + 1)
    knots = np.concatenate([[inner[0]] * degree, inner, [inner[-1]] * degree])
    # scipy leaves the last knot out of the last interval unless it extrapolates
    expected = BSpline(knots, np.eye(count), degree, extrapolate=True)(INSIDE)
    got = Shape.parse(f"spline:{count}").basis(INSIDE, AXIS)
    assert got.shape == (len(INSIDE), count)
    np.testing.assert_allclose(got, expected, atol=2e-12)


@pytest.mark.parametrize("code", ["spline:1", "spline:2", "spline:6", "spline:30"])
def test_splines_are_a_partition_of_unity(code):
    basis = Shape.parse(code).basis(INSIDE, AXIS)
    np.testing.assert_allclose(basis.sum(axis=1), 1.0, atol=1e-13)
    assert (basis >= 0.0).all()


@pytest.mark.parametrize("degree", [0, 1, 4, 20])
def test_polynomials_are_legendre(degree):
    x = (INSIDE - 290.0) / 410.0
    got = Shape.parse(f"polynomial:{degree}").basis(INSIDE, AXIS)
    expected = np.stack([eval_legendre(k, x) for k in range(degree + 1)], axis=1)
    np.testing.assert_allclose(got, expected, atol=1e-12)


@pytest.mark.parametrize("code", CODES)
def test_ends_are_held_outside_the_travel(code):
    shape = Shape.parse(code)
    ends = shape.basis(np.array([-120.0, -120.0, 700.0, 700.0]), AXIS)
    np.testing.assert_array_equal(shape.basis(OUTSIDE, AXIS), ends)


@given(
    st.lists(st.integers(-5000, 5000), min_size=2, max_size=30, unique=True),
    st.lists(st.floats(-6000, 6000), min_size=1, max_size=20),
    st.integers(0, 2**32 - 1),
)
def test_tables_against_numpy_interp(nodes, positions, seed):
    nodes = sorted(n / 8.0 for n in nodes)
    values = np.random.default_rng(seed).normal(size=len(nodes))
    basis = Shape.parse("table", nodes).basis(np.array(positions), AXIS)
    np.testing.assert_allclose(basis @ values, np.interp(positions, nodes, values), atol=1e-9)
    np.testing.assert_allclose(basis.sum(axis=1), 1.0, atol=1e-12)


def test_a_table_gives_its_nodes_exactly():
    nodes = (-200.0, -150.0, -30.1, 0.0)
    np.testing.assert_array_equal(
        Shape.parse("table", nodes).basis(np.array(nodes), AXIS), np.eye(4)
    )


@pytest.mark.parametrize(
    ("code", "nodes", "names"),
    [
        ("constant", (), ("value",)),
        ("polynomial:2", (), ("c0", "c1", "c2")),
        ("spline:3", (), ("c1", "c2", "c3")),
        ("table", (0.0, 1.0), ("v1", "v2")),
    ],
)
def test_names_go_with_columns(code, nodes, names):
    shape = Shape.parse(code, nodes)
    assert shape.names == names
    assert shape.basis(np.zeros(4), AXIS).shape == (4, shape.size) == (4, len(names))


def test_kinks_are_where_slopes_jump():
    assert Shape.parse("table", (0.0, 5.0, 9.0)).kinks(AXIS) == (0.0, 5.0, 9.0)
    assert Shape.parse("spline:8").kinks(AXIS) == AXIS.travel


@pytest.mark.parametrize(
    ("code", "nodes", "message"),
    [
        ("cubic", (), "unknown shape"),
        ("polynomial", (), "unknown shape"),
        ("spline:0", (), "shape out of range"),
        ("spline:201", (), "shape out of range"),
        ("polynomial:21", (), "shape out of range"),
        ("polynomial:-1", (), "unknown shape"),
        ("table", (), "a table needs its positions"),
        ("table", (1.0,), "a table needs its positions"),
        ("table", (1.0, 1.0), "strictly increasing"),
        ("table", (2.0, 1.0), "strictly increasing"),
        ("spline:8", (0.0, 1.0), "positions belong to shapes 'table' and 'spline:auto' only"),
    ],
)
def test_errors(code, nodes, message):
    with pytest.raises(InputError, match=message):
        Shape.parse(code, nodes)
