"""One temperature beside many positions: numbers stand for all rows."""

import numpy as np
import pytest

from abbe.compcore.machine.conditions import Conditions

X = np.linspace(0.0, 500.0, 5)


def test_a_number_stands_for_all_rows() -> None:
    made = Conditions(
        {"X": X, "Y": 10.0},
        directions={"X": 1},
        tool=(0.0, 0.0, -100.0),
        time=3.0,
        signals={"T": 21.5, "load": [100.0]},
    )
    assert made.n == 5
    assert made.position("Y").tolist() == [10.0] * 5
    assert made.direction("X").tolist() == [1.0] * 5
    assert made.tool.tolist() == [[0.0, 0.0, -100.0]] * 5
    assert made.time.tolist() == [3.0] * 5
    assert made.signal("T").tolist() == [21.5] * 5
    assert made.signal("load").tolist() == [100.0] * 5


def test_whichever_comes_first() -> None:
    made = Conditions({"Y": np.array([10.0]), "X": X}, signals={"T": np.full(5, 20.0)})
    assert made.n == 5
    assert made.position("Y").tolist() == [10.0] * 5


def test_only_numbers_are_one_row() -> None:
    made = Conditions({"X": 1.0}, signals={"T": 20.0})
    assert made.n == 1
    assert made.tool.shape == (1, 3)


def test_numbers_beside_no_rows() -> None:
    assert Conditions({"X": np.zeros(0)}, signals={"T": 20.0}).n == 0


def test_a_wrong_length_is_named() -> None:
    with pytest.raises(ValueError, match=r"signal T has shape \(2,\), expected \(5,\)"):
        Conditions({"X": X}, signals={"T": np.array([20.0, 21.0])})


def test_arrays_are_kept_as_they_are() -> None:
    temperature = np.full(5, 20.0)
    made = Conditions({"X": X}, signals={"T": temperature})
    assert made.positions["X"] is X
    assert made.signals["T"] is temperature
