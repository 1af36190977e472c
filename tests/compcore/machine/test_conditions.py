from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions, unit_of
from abbe.compcore.machine.lag import first_order_lag


def test_scalars_and_arrays_broadcast():
    c = Conditions.at(
        {"X": [1.0, 2.0, 3.0], "Y": 5.0},
        tool=(0.0, 0.0, -50.0),
        directions={"X": 1.0},
        signals={"T": [20.0, 21.0, 22.0]},
    )
    assert c.n == 3
    assert c.position("Y").tolist() == [5.0, 5.0, 5.0]
    assert c.tool.tolist() == [[0.0, 0.0, -50.0]] * 3
    assert c.direction("X").tolist() == [1.0] * 3
    assert c.direction("Y").tolist() == [0.0] * 3, "not recorded: unknown"
    assert c.time.tolist() == [0.0] * 3


def test_tool_may_differ_from_row_to_row():
    tools = np.array([[0.0, 0.0, -50.0], [10.0, 0.0, 0.0]])
    c = Conditions.at({"X": 1.0}, tool=tools)
    assert c.n == 2
    np.testing.assert_array_equal(c.tool, tools)


def test_lengths_that_disagree_are_refused():
    with pytest.raises(ValueError, match=r"position Y has shape \(2,\), expected \(3,\)"):
        Conditions({"X": np.zeros(3), "Y": np.zeros(2)})
    with pytest.raises(ValueError, match="tool has shape"):
        Conditions({"X": np.zeros(3)}, tool=np.zeros((2, 3)))


def test_what_was_not_recorded_is_said():
    c = Conditions.at({"X": 0.0}, signals={"T_b": 20.0, "T_a": 20.0})
    with pytest.raises(InputError, match="no positions of axis Y were recorded"):
        c.position("Y")
    with pytest.raises(InputError, match="field 'T_x'.*not recorded.*one of T_a, T_b"):
        c.signal("T_x")
    with pytest.raises(InputError, match="one of none recorded"):
        Conditions.at({"X": 0.0}).signal("T_x")


def test_mean_of_signals_and_lag():
    t = np.array([0.0, 10.0, 30.0])
    a, b = np.array([20.0, 21.0, 25.0]), np.array([22.0, 22.0, 20.0])
    c = Conditions({"X": np.zeros(3)}, time=t, signals={"a": a, "b": b})
    np.testing.assert_allclose(c.mean_signal(("a", "b")), (a + b) / 2)
    lagged = (first_order_lag(t, a, 7.0) + first_order_lag(t, b, 7.0)) / 2
    np.testing.assert_allclose(c.mean_signal(("a", "b"), 7.0), lagged)


def test_runs_have_clocks_of_their_own():
    t = np.array([0.0, 10.0, 0.0, 10.0])
    value = np.array([20.0, 21.0, 30.0, 30.0])
    run = np.array([0, 0, 1, 1])
    c = Conditions({"X": np.zeros(4)}, time=t, signals={"T": value}, run=run)
    lagged = c.lag("T", 5.0)
    np.testing.assert_allclose(lagged[:2], first_order_lag(t[:2], value[:2], 5.0))
    np.testing.assert_allclose(lagged[2:], [30.0, 30.0])


def test_picked_rows_keep_the_lag_of_the_whole_table():
    t = np.linspace(0.0, 100.0, 11)
    value = np.linspace(20.0, 30.0, 11)
    c = Conditions({"X": np.arange(11.0)}, time=t, signals={"T": value})
    whole = c.lag("T", 20.0)
    some = c.rows(np.array([5, 10]))
    np.testing.assert_array_equal(some.lag("T", 20.0), whole[[5, 10]])
    assert some.position("X").tolist() == [5.0, 10.0]
    assert c.rows(slice(2, 4)).n == 2


def test_given_lags_are_taken_instead_of_computed():
    given = {("T", 5.0): np.array([42.0])}
    c = Conditions({"X": np.zeros(1)}, signals={"T": np.array([20.0])}, given_lags=given)
    assert c.lag("T", 5.0).tolist() == [42.0]


def test_moved_displaces_the_named_axes_only():
    c = Conditions.at({"X": [1.0, 2.0], "Y": 5.0}, signals={"T": 20.0})
    m = c.moved({"X": np.array([0.5, -0.5])})
    assert m.position("X").tolist() == [1.5, 1.5]
    assert m.position("Y").tolist() == [5.0, 5.0]
    assert c.position("X").tolist() == [1.0, 2.0]


def test_no_rows():
    assert Conditions.at({"X": []}).n == 0


def test_units_of_axes():
    assert [unit_of(a) for a in "XWAC"] == ["mm", "mm", "rad", "rad"]


def test_of_an_amended_reading_only_the_lags_that_are_asked_for_are_amended():
    """A search leaves thousands of lags behind; amending them all took a third of a diagnosis."""
    t = np.linspace(0.0, 100.0, 11)
    value = np.linspace(20.0, 30.0, 11)
    c = Conditions({"X": np.arange(11.0)}, time=t, signals={"T": value, "U": 2.0 * value})
    whole = {tau: c.lag("T", tau) for tau in np.linspace(5.0, 50.0, 300)}
    seen: list[NDArray[np.float64]] = []

    def counted(v: NDArray[np.float64]) -> NDArray[np.float64]:
        seen.append(v)
        return v + 1.0

    amended = c._with_reading("T", counted)
    assert len(seen) == 1, "the reading itself"
    np.testing.assert_array_equal(amended.lag("T", 5.0), whole[5.0] + 1.0)
    assert len(seen) == 2
    # rows of it, amended again: of the whole table's lags, each change in its turn
    rows = np.array([3, 7])
    twice = amended.rows(rows).with_gain("T", 2.0, 20.0)
    np.testing.assert_array_equal(
        twice.lag("T", 50.0), 20.0 + 2.0 * (whole[50.0] + 1.0 - 20.0)[rows]
    )
    np.testing.assert_array_equal(c.with_offset("T", 1.0).lag("U", 5.0), c.lag("U", 5.0))
