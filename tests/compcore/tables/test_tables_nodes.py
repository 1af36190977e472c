"""Where points stand: against every possible choice, and within the rules of controllers."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from abbe.compcore.errors import InputError
from abbe.compcore.tables.capability import Spacing
from abbe.compcore.tables.projection.curves.nodes import (
    best,
    equidistant,
    fewest,
    interpolation_error,
    place,
)


def every_choice(positions: np.ndarray, curves: np.ndarray, count: int) -> float:
    """Least greatest interpolation error over all choices of up to `count` points."""
    inner = range(1, len(positions) - 1)
    return min(
        interpolation_error(positions, curves, positions[[0, *chosen, len(positions) - 1]])
        for number in range(count - 1)
        for chosen in combinations(inner, number)
    )


curves = st.integers(6, 10).flatmap(
    lambda m: st.tuples(
        st.lists(st.integers(1, 9), min_size=m - 1, max_size=m - 1),
        st.lists(st.lists(st.integers(-50, 50), min_size=m, max_size=m), min_size=1, max_size=2),
    )
)


@given(curves, st.integers(2, 6))
def test_no_other_choice_of_so_many_points_is_better(drawn, count):
    steps, values = drawn
    positions = np.concatenate([[0.0], np.cumsum(steps)])
    functions = np.array(values, dtype=float)
    chosen = best(positions, functions, count)
    assert len(chosen) <= count
    found = interpolation_error(positions, functions, positions[chosen])
    assert found == pytest.approx(every_choice(positions, functions, count), rel=1e-6, abs=1e-9)


@given(curves, st.floats(0.5, 60.0))
def test_no_fewer_points_keep_a_tolerance(drawn, tolerance):
    steps, values = drawn
    positions = np.concatenate([[0.0], np.cumsum(steps)])
    functions = np.array(values, dtype=float)
    chosen = fewest(positions, functions, tolerance)
    assert interpolation_error(positions, functions, positions[chosen]) <= tolerance + 1e-9
    if len(chosen) > 2:
        assert every_choice(positions, functions, len(chosen) - 1) > tolerance


def test_points_stand_where_the_curve_bends_as_theory_says():
    """Equidistribution of √|f″|: for x⁴ on 0 … 1 the n-th of N points is at (n/N)^(1/2)."""
    x = np.linspace(0.0, 1.0, 241)
    nodes = place(x, (x**4)[None], Spacing(), 9, 0.0)
    assert len(nodes) == 9
    assert nodes == pytest.approx(np.sqrt(np.linspace(0.0, 1.0, 9)), abs=0.09)
    even = interpolation_error(x, (x**4)[None], np.linspace(0.0, 1.0, 9))
    assert interpolation_error(x, (x**4)[None], nodes) < 0.5 * even


def test_a_broken_line_needs_its_corners_only():
    x = np.linspace(0.0, 100.0, 101)
    curve = np.interp(x, [0.0, 13.0, 40.0, 41.0, 100.0], [0.0, 5.0, -3.0, 8.0, 1.0])
    nodes = place(x, curve[None], Spacing(), 256, 1e-9)
    assert nodes.tolist() == [0.0, 13.0, 40.0, 41.0, 100.0]


def test_points_keep_their_least_distance_and_lie_on_the_unit():
    x = np.linspace(0.0, 10.0, 201)
    curve = np.abs(x - 3.333)[None]
    nodes = place(x, curve, Spacing(least=1.0, unit=0.5), 50, 1e-6)
    assert np.diff(nodes).min() >= 1.0 - 1e-9
    assert np.abs(nodes * 2 - np.round(nodes * 2)).max() < 1e-9


@given(
    st.floats(-900.0, 0.0),
    st.floats(5.0, 1500.0),
    st.integers(2, 400),
    st.sampled_from([0.001, 0.01, 0.02]),
    st.booleans(),
)
def test_equidistant_points_reach_from_end_to_end_on_the_unit(low, length, count, unit, zero):
    count = max(count, 3) if zero else count
    nodes = equidistant(low, low + length, count, Spacing("equidistant", 0.0, unit, zero))
    assert len(nodes) <= max(count, 2)
    step = nodes[1] - nodes[0]
    assert np.diff(nodes) == pytest.approx(step, abs=1e-7)
    assert nodes[0] <= low + 1e-6
    assert nodes[-1] >= low + length - 1e-6
    assert step / unit == pytest.approx(round(step / unit), abs=1e-5)
    origin = nodes[0] / (step if zero else unit)
    assert origin == pytest.approx(round(origin), abs=1e-4)
    # nothing is wasted: with one step more the table would be shorter than its axis by far
    assert step <= 1.2 * length / (count - 1) + 2.5 * unit + (0.6 * step if zero else 0.0)


def test_powers_of_two_use_the_widest_distance_that_will_do():
    x = np.linspace(0.0, 300.0, 301)
    rule = Spacing("power of two", unit=0.001, powers=(6, 23))
    straight = place(x, (0.01 * x)[None], rule, 64, 1e-4)
    assert len(straight) == 2
    wavy = place(x, 0.01 * np.sin(x / 20.0)[None], rule, 64, 1e-4)
    assert np.diff(wavy)[0] == pytest.approx(8.192)
    with pytest.raises(InputError, match="longer than the table can reach"):
        place(x * 1e6, (0.01 * x)[None], rule, 3, 1e-4)


def test_as_few_equidistant_points_as_it_takes():
    x = np.linspace(0.0, 100.0, 401)
    curve = (1e-6 * (x - 50.0) ** 2)[None]
    nodes = place(x, curve, Spacing("equidistant", unit=0.001), 200, 1e-4)
    # chord error h²/8·f″ = 1e-4 → h = 20
    assert 5 <= len(nodes) <= 8
    assert interpolation_error(x, curve, np.clip(nodes, 0.0, 100.0)) <= 1e-4


def test_points_on_both_sides_of_one_at_zero_are_three_at_least():
    """Zero must be a point, and so must both ends: two points cannot do."""
    where = np.linspace(-100.0, 100.0, 41)
    spacing = Spacing("equidistant", 0.1, 1e-3, through_zero=True)
    nodes = place(where, 1e-3 * where[None], spacing, 128, 1e-6)
    assert nodes == pytest.approx([-100.0, 0.0, 100.0])
    with pytest.raises(InputError, match="too few points"):
        place(where, 1e-3 * where[None], spacing, 2, 1e-6)
