"""Readings that step: seen where the step is coarse, and only then."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from abbe.compcore.campaign.resolution import coarse_step, of_step


@given(
    st.sampled_from([0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 25.0]),
    st.integers(1, 30),
    st.integers(30, 300),
    st.integers(0, 2**32 - 1),
)
def test_a_display_s_step_is_seen(step: float, steps: int, n: int, seed: int) -> None:
    values = np.random.default_rng(seed).uniform(-steps * step, steps * step, n)
    read = np.round(values / step) * step * 1e-3
    if len(np.unique(read)) >= 3 and np.isclose(np.diff(np.unique(read)).min(), step * 1e-3):
        assert coarse_step(read) == pytest.approx(step * 1e-3)


@given(st.integers(8, 300), st.integers(0, 2**32 - 1))
def test_a_fine_reading_has_no_step(n: int, seed: int) -> None:
    assert coarse_step(np.random.default_rng(seed).normal(0.0, 1e-3, n)) == 0.0


def test_a_step_s_standard_deviation_is_that_of_what_rounding_leaves() -> None:
    values = np.linspace(0.0, 100.0, 100_001)
    left = np.std(values - np.round(values))
    assert of_step(1.0) == pytest.approx(float(left), rel=1e-3)
    assert of_step(1.0) == pytest.approx(1.0 / math.sqrt(12.0))
