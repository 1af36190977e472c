"""Approach directions are told from motion, not from noise."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from abbe.daemon.pipeline.reading.directions import Directions


def last(positions: list[float], deadband: float = 0.01) -> float:
    directions = Directions([deadband])
    found = [0.0]
    for position in positions:
        found = directions.step([position])
    return found[0]


def test_nothing_is_known_before_the_first_motion() -> None:
    assert last([5.0]) == 0.0
    assert last([5.0, 5.005, 4.995]) == 0.0


def test_motion_decides_and_a_standstill_keeps_it() -> None:
    assert last([0.0, 1.0]) == 1.0
    assert last([0.0, 1.0, 1.0, 1.0]) == 1.0
    assert last([0.0, 1.0, 0.5]) == -1.0
    assert last([0.0, -0.02, math.nan, -0.02]) == -1.0


def test_slow_motion_counts_from_the_farthest_point() -> None:
    creeping_back = [1.0 - 0.001 * i for i in range(12)]
    assert last([0.0, *creeping_back]) == -1.0
    assert last([0.0, *creeping_back[:9]]) == 1.0


@given(st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=50), st.floats(-0.0049, 0.0049))
def test_noise_within_the_deadband_never_turns(noise: list[float], at: float) -> None:
    positions = [0.0, 1.0] + [1.0 + at + 0.0049 * n for n in noise]
    assert last(positions) == 1.0
