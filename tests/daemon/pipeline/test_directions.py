"""Approach directions are told from motion, not from noise."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from abbe.daemon.config.sections.readings import AxisSection
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


def test_a_rotary_axis_turns_after_a_hundredth_of_a_degree() -> None:
    """Plans approach its targets by 0.2°: with 0.01 rad nobody knew from which side."""
    plain = AxisSection(source="cnc.c")
    assert plain.turns_after("C") == pytest.approx(math.radians(0.01))
    assert plain.turns_after("X") == 0.01
    assert AxisSection(source="cnc.c", deadband=0.002).turns_after("C") == 0.002
