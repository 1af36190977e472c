"""Reversal in three forms, increments and back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from abbe.compcore.errors import InputError
from abbe.compcore.tables.form import (
    accumulated,
    from_reversal,
    increments,
    reversal_columns,
    to_single,
)
from abbe.compcore.tables.table import Table, move

# ISO/TR 16907:2015, table 1: X 0/50/100 mm
NODES = np.array([0.0, 50.0, 100.0])
UP = np.array([0.0, 0.0015, 0.0019])
DOWN = np.array([0.0008, 0.0022, 0.0025])
TABLE = Table(move("X"), ("X",), (NODES,), UP, DOWN)


def test_the_standards_example_as_difference():
    first, second = reversal_columns(TABLE, "difference")
    assert first.tolist() == UP.tolist()
    assert second == pytest.approx([0.0008, 0.0007, 0.0006])


@pytest.mark.parametrize("reversal", ["columns", "difference"])
def test_two_columns_say_all(reversal):
    first, second = reversal_columns(TABLE, reversal)
    again = from_reversal(Table(move("X"), ("X",), (NODES,), first), second, reversal)
    assert again.difference(TABLE) < 1e-15


def test_a_single_value_is_half_the_mean_reversal_by_direction():
    mean, half = reversal_columns(TABLE, "single")
    assert mean == pytest.approx(0.5 * (UP + DOWN))
    assert half == pytest.approx(np.full(3, -0.00035))
    single = to_single(TABLE)
    assert single.forward - single.downward == pytest.approx(np.full(3, -0.0007))
    assert to_single(single).difference(single) < 1e-15
    plain = Table(move("X"), ("X",), (NODES,), UP)
    assert to_single(plain) is plain


@given(
    st.lists(st.integers(-400, 400), min_size=2, max_size=30, unique=True),
    st.integers(0, 29),
)
def test_increments_add_up_again_from_any_point(places, which):
    nodes = np.array(sorted(places), dtype=float)
    values = np.sin(nodes) + 0.01 * nodes
    origin = float(nodes[which % len(nodes)])
    steps = increments(values, nodes, origin)
    assert accumulated(steps, nodes, origin) == pytest.approx(values, abs=1e-12)
    at = which % len(nodes)
    assert steps[at] == values[at]
    if at + 1 < len(nodes):
        assert steps[at + 1] == pytest.approx(values[at + 1] - values[at])
    if at:
        assert steps[at - 1] == pytest.approx(values[at - 1] - values[at])


def test_increments_count_from_a_point_of_the_table():
    with pytest.raises(InputError, match="count from a point"):
        increments(UP, NODES, 20.0)
