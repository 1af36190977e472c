"""Targets of a line: read back, set exactly, on a sweep, in two groups."""

from __future__ import annotations

import time
import tracemalloc

import numpy as np
import pytest

from abbe.compcore.campaign.targets import targets
from abbe.compcore.machine.conditions import Conditions


def seen(at: np.ndarray, axis: str = "X", u: np.ndarray | None = None) -> np.ndarray:
    return targets(Conditions({axis: at}, u=u), axis, rotary=axis == "C")


SET = np.array([-5.0, 0.0, 10.0, 20.0, 30.0, 40.0])


def test_a_scale_that_is_read_back_shows_targets_not_figures() -> None:
    rng = np.random.default_rng(4)
    at = np.deg2rad(np.repeat(SET, 6) + rng.uniform(-0.01, 0.01, 36))
    found = np.rad2deg(seen(at, "C"))
    assert len(found) == len(SET)
    assert found == pytest.approx(SET, abs=0.01)


def test_two_sides_of_a_target_that_differ_by_nothing_are_one() -> None:
    """From below 9.99491, from above 9.99492: not twice as many targets."""
    at = np.concatenate([SET, SET, SET + 1e-5, SET + 1e-5])
    assert len(seen(at)) == len(SET)


def test_groups_of_targets_are_not_taken_for_one() -> None:
    at = np.repeat([0.0, 5.0, 10.0, 300.0, 305.0, 310.0], 3)
    assert len(seen(at)) == 6


@pytest.mark.parametrize("at", [np.linspace(0.0, 90.0, 400), np.arange(9.0), np.full(9, 4.0)])
def test_a_sweep_and_places_that_were_read_once_are_no_targets(at: np.ndarray) -> None:
    assert len(seen(at)) == 0


def test_a_sweep_beside_one_far_reading_is_no_pair_of_targets() -> None:
    at = np.concatenate([np.linspace(0.0, 10.0, 200), [500.0]])
    assert len(seen(at)) == 0


def test_two_components_of_one_stand_are_one_reading() -> None:
    """Each star of a night gives two rows, at a place where the axis never stands again."""
    at = np.repeat(np.random.default_rng(1).uniform(-180.0, 180.0, 90), 2)
    assert len(seen(at, u=np.tile([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], (90, 1)))) == 0


def test_a_sweep_of_many_places_is_looked_at_in_no_time() -> None:
    """Thousands of readings whose gaps all differ, as of a long day on its way."""
    rng = np.random.default_rng(6)
    places = rng.uniform(0.0, 700.0, 1500)
    at = np.repeat(places, 4) + rng.uniform(-0.2, 0.2, 6000)
    began = time.process_time()
    assert not len(seen(at))
    assert time.process_time() - began < 1.0


def test_many_readings_of_many_targets_take_no_table_of_all_pairs() -> None:
    """A day of a million rows with seven thousand targets asked for 51 GB."""
    at = np.tile(np.arange(3000.0), 30)
    tracemalloc.start()
    try:
        assert len(seen(at)) == 3000
        assert tracemalloc.get_traced_memory()[1] < 1000 * len(at)
    finally:
        tracemalloc.stop()
