"""Whole steps without bias, ranges, increments."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from abbe.compcore.tables.projection.curves.hats import node_weights
from abbe.compcore.tables.projection.curves.quantise import quantise, rounded, slope_limited

numbers = st.lists(st.floats(-40.0, 40.0), min_size=3, max_size=40).map(np.array)


@given(numbers, st.floats(0.0, 1.0))
def test_the_mean_of_an_interpolated_table_is_not_biased(values, uneven):
    """Its mean is off by less than the smallest step of any one entry could mend."""
    nodes = np.cumsum(1.0 + uneven * np.arange(len(values)) % 3)
    weights = node_weights(nodes)
    whole = rounded(values, 1.0, weights)
    error = whole - values
    assert np.abs(error).max() <= 1.0
    mean = abs(error @ weights) / weights.sum()
    plain = abs((np.rint(values) - values) @ weights) / weights.sum()
    assert mean <= plain + 1e-12
    candidates = weights[(error != 0.0) & (np.abs(error) <= 0.5)] / weights.sum()
    if len(candidates) and mean > 0.0:
        helping = [
            w for w, e in zip(weights / weights.sum(), error, strict=True)
            if e * (error @ weights) > 0.0 and abs(e) <= 0.5
        ]  # fmt: skip
        # no single entry can be rounded the other way and bring the mean nearer to zero
        assert all(abs(mean - w) >= mean - 1e-12 for w in helping)


def test_a_systematic_rounding_error_is_taken_out():
    values = np.full(101, 0.4)
    whole = rounded(values, 1.0, node_weights(np.arange(101.0)))
    assert np.rint(values).sum() == 0.0
    assert (whole - values)[1:-1].mean() == pytest.approx(0.0, abs=0.01)
    assert set(whole.tolist()) == {0, 1}


@given(numbers)
def test_fixed_entries_are_rounded_to_the_nearest(values):
    fixed = np.zeros(len(values), dtype=bool)
    fixed[::3] = True
    whole = rounded(values, 1.0, np.ones(len(values)), fixed)
    assert (whole[fixed] == np.rint(values[fixed])).all()


small = st.lists(st.integers(-9, 9), min_size=2, max_size=6)


@given(small, st.integers(1, 4))
def test_limited_steps_are_the_nearest_there_are(values, limit):
    """Against every table of whole numbers whose neighbours differ by no more than the limit."""
    wanted = np.array(values)
    found = slope_limited(wanted, limit)
    assert (np.abs(np.diff(found)) <= limit).all()
    mine = np.abs(found - wanted).max()
    for off in range(mine):
        allowed = [range(v - off, v + off + 1) for v in values]
        reach = dict.fromkeys(allowed[0], True)
        for choices in allowed[1:]:
            reach = {n: True for n in choices if any(abs(n - m) <= limit for m in reach)}
        assert not reach, "a nearer table exists"


@given(small)
def test_steps_within_the_limit_stay_as_they_are(values):
    wanted = np.array(values)
    limit = max(1, int(np.abs(np.diff(wanted)).max()))
    assert (slope_limited(wanted, limit) == wanted).all()


@given(numbers, st.floats(0.05, 3.0), st.integers(2, 30))
def test_ranges_and_increments_are_respected_at_once(values, step, limit):
    nodes = np.arange(float(len(values)))
    span = float(np.abs(values).max())
    assume(span > 0.0)
    found = quantise(
        values, nodes, step, value_range=(-0.7 * span, 0.7 * span), increment_limit=limit
    )
    counts = found.values / step
    assert counts == pytest.approx(np.rint(counts), abs=1e-9)
    assert (np.abs(np.diff(np.rint(counts))) <= limit).all()
    assert np.abs(found.values).max() <= 0.7 * span + 1e-9
    assert found.limited > 0.0


def test_no_step_means_no_rounding():
    values = np.array([0.1234567, -0.5])
    assert quantise(values, np.arange(2.0), 0.0).values is values


def test_a_zero_stays_zero_also_with_increments():
    values = np.array([9.0, 4.0, 0.0, 6.0, 13.0])
    for limit in (2, 3, 9):
        found = quantise(values, np.arange(5.0), 1.0, increment_limit=limit, zero=2)
        assert found.values[2] == 0.0
        assert np.abs(np.diff(found.values)).max() <= limit


def test_all_small_cases_of_unbiased_rounding():
    """The best mean that turning single entries can reach is reached, for all tiny tables."""
    for parts in itertools.product((0.1, 0.3, 0.45), repeat=4):
        values = np.array(parts)
        whole = rounded(values, 1.0, np.ones(4))
        assert abs((whole - values).mean()) <= 0.125 + 1e-12
