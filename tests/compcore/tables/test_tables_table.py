"""One table: interpolation, directions, signs, sums, and the lever."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.tables.table import Sign, Table, move, superposed

NODES = np.array([0.0, 10.0, 40.0, 100.0])
UP = np.array([0.0, 0.004, -0.002, 0.010])
DOWN = UP + np.array([0.003, 0.003, 0.004, 0.001])


def table(**more: object) -> Table:
    return Table(move("X"), ("X",), (NODES,), UP, **more)  # type: ignore[arg-type]


def at(x: list[float], direction: list[float] | None = None, y: float = 0.0) -> Conditions:
    facing = {} if direction is None else {"X": np.array(direction)}
    return Conditions.at({"X": np.array(x), "Y": y}, directions=facing)


def test_straight_between_nodes_and_held_beyond():
    assert table().value(at([5.0, 25.0, -7.0, 130.0])) == pytest.approx([2e-3, 1e-3, 0.0, 1e-2])


@pytest.mark.parametrize("dimensions", [2, 3])
def test_multilinear_as_scipy_has_it(dimensions):
    rng = np.random.default_rng(dimensions)
    nodes = tuple(np.sort(rng.uniform(0.0, 100.0, 4 + k)) for k in range(dimensions))
    values = rng.normal(size=tuple(len(n) for n in nodes))
    axes = ("X", "Y", "Z")[:dimensions]
    one = Table(move("X"), axes, nodes, values)
    where = rng.uniform(-20.0, 120.0, (300, dimensions))
    held = np.clip(where, [n[0] for n in nodes], [n[-1] for n in nodes])
    conditions = Conditions.at(dict(zip(axes, where.T, strict=True)))
    assert one.value(conditions) == pytest.approx(
        RegularGridInterpolator(nodes, values)(held), abs=1e-12
    )


def test_each_direction_has_its_own_values_and_an_unknown_one_their_mean():
    one = table(backward=DOWN)
    found = one.value(at([10.0, 10.0, 10.0], [1.0, -1.0, 0.0]))
    assert found == pytest.approx([0.004, 0.007, 0.0055])


def test_a_compensation_is_the_error_with_its_sign_turned():
    error = table(backward=DOWN)
    compensation = error.as_sign(Sign.COMPENSATION)
    assert compensation.forward == pytest.approx(-UP)
    assert compensation.downward == pytest.approx(-DOWN)
    where = at([3.0, 77.0], [1.0, -1.0])
    assert compensation.value(where) == pytest.approx(error.value(where))
    assert compensation.as_sign(Sign.ERROR).difference(error) == 0.0


def test_a_lever_multiplies_by_another_axis():
    one = Table(move("X"), ("X",), (NODES,), UP * 1e-3, lever=("Y", 50.0))
    assert one.value(at([10.0], y=250.0)) == pytest.approx([0.004e-3 * 200.0])
    assert one.name == "E_XX·Y"


def test_names_are_iso_230_names():
    square = np.zeros((2, 2))
    two = (np.array([0.0, 1.0]),) * 2
    assert Table(move("Y"), ("X",), (NODES,), UP).name == "E_YX"
    assert Table(ErrorMotion("X", "C"), ("X",), (NODES,), UP).name == "E_CX"
    assert Table(move("Y"), ("X", "Y"), two, square).name == "E_Y(X,Y)"
    assert Table(ErrorMotion("C", "C"), ("C",), (NODES,), UP).name == "E_CC"


@pytest.mark.parametrize(
    ("nodes", "values"),
    [([0.0, 0.0], [1.0, 2.0]), ([1.0, 0.0], [1.0, 2.0]), ([0.0, 1.0], [1.0])],
)
def test_bad_nodes_are_refused(nodes, values):
    with pytest.raises(ValueError, match="E_XX"):
        Table(move("X"), ("X",), (np.array(nodes),), np.array(values))


lines = st.lists(st.integers(-2000, 2000), min_size=2, max_size=9, unique=True).flatmap(
    lambda q: st.tuples(
        st.just(np.array(sorted(q), dtype=float)),
        st.lists(st.floats(-0.1, 0.1), min_size=len(q), max_size=len(q)).map(np.array),
    )
)


@given(lines, lines, st.booleans())
def test_a_sum_is_the_sum_everywhere(one, other, directional):
    a = Table(move("X"), ("X",), (one[0],), one[1], one[1] * 0.5 if directional else None)
    b = Table(move("X"), ("X",), (other[0],), other[1]).as_sign(Sign.COMPENSATION)
    total = a.plus(b)
    x = np.linspace(-2500.0, 2500.0, 101)
    for direction in (1.0, -1.0):
        where = Conditions.at({"X": x}, directions={"X": direction})
        assert total.value(where) == pytest.approx(a.value(where) + b.value(where), abs=1e-12)


def test_superposed_adds_what_is_the_same_and_keeps_the_rest():
    other = Table(move("Y"), ("X",), (NODES,), UP * 2.0)
    total = superposed([table(), other], [table().as_sign(Sign.COMPENSATION)])
    assert [t.name for t in total] == ["E_XX", "E_YX"]
    assert total[0].forward == pytest.approx(UP * 2.0)
    assert all(t.sign is Sign.ERROR for t in total)
