"""What is worked out once of rows: never that of other rows, machines or positions."""

from __future__ import annotations

import numpy as np

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from tests.support.compcore.five_axis import machine_of

MIXED, HEAD = machine_of("w Y' C' b X Z B t"), machine_of("w b X Y Z C B t")


def rows(angle: float) -> Conditions:
    places = dict.fromkeys("XYZ", 10.0) | {"B": angle, "C": 0.5}
    return Conditions.at({a: np.array([p, 2.0 * p]) for a, p in places.items()})


def test_a_chain_is_made_once_for_the_same_rows_of_the_same_machine():
    at = rows(0.2)
    assert Chain.of(MIXED, at) is Chain.of(MIXED, at)


def test_other_rows_other_machines_and_amended_positions_have_chains_of_their_own():
    at = rows(0.2)
    first = Chain.of(MIXED, at)
    moved = at.moved({"B": np.full(2, 0.1)})
    for machine, where in ((HEAD, at), (MIXED, rows(0.3)), (MIXED, moved)):
        chain = Chain.of(machine, where)
        assert not np.allclose(chain.point, first.point)
        np.testing.assert_array_equal(chain.point, Chain(machine, where).point)
    one = at.rows(np.array([1]))
    np.testing.assert_array_equal(Chain.of(MIXED, one).point, first.point[1:])


def test_positions_that_are_exchanged_in_place_are_seen():
    at = Conditions(dict(rows(0.2).positions))
    before = Chain.of(MIXED, at).point
    at.positions["B"] = np.array([0.7, 0.9])
    assert not np.allclose(Chain.of(MIXED, at).point, before)
