"""How fine a curve may be: between its targets it is about as sure as a reading is."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_lsq_spline

from abbe.compcore.effects.registry import make_effect
from abbe.compcore.fitting.detail import finer
from abbe.compcore.machine.conditions import Conditions
from tests.support.compcore.fit_cases import bridge

TRAVEL = 700.0
DRAWS = 40
"""Readings of nothing but noise, of standard deviation 1."""


def largest_sd(at: NDArray[np.float64], count: int) -> float:
    """Of SciPy's least squares spline through noise, the largest scatter between first and last."""
    inner = np.linspace(0.0, TRAVEL, count - 2)
    knots = np.concatenate([[0.0] * 3, inner, [TRAVEL] * 3])
    noise = np.random.default_rng(3).normal(size=(len(at), DRAWS))
    fitted: BSpline = make_lsq_spline(at, noise, knots, k=3)
    between = np.linspace(at[0], at[-1], 2000)
    return float(np.sqrt(np.mean(fitted(between) ** 2, axis=1)).max())


@pytest.mark.parametrize("uneven", [0.0, 0.35])
def test_what_is_offered_is_sure_between_its_targets(uneven: float) -> None:
    """A rail's 33 targets, even or not (ISO 230-2): 34 coefficients swing between uneven ones."""
    rng = np.random.default_rng(5)
    at = np.linspace(0.0, TRAVEL, 33)
    at[1:-1] += rng.uniform(-uneven, uneven, 31) * (at[1] - at[0])
    conditions = Conditions({"X": np.concatenate([at, at + 0.01, at - 0.01])})
    effect = make_effect("angular", {"axis": "X", "about": "Y", "shape": "spline:12"})
    machine = bridge()
    offered = [str(w["shape"]) for w in finer(effect, conditions, machine) if w["shape"] != "table"]
    counts = [int(shape.partition(":")[2]) for shape in offered]
    assert counts
    assert max(counts) > 20
    for count in counts:
        assert largest_sd(at, count) < 2.6
    if uneven:
        # one more than is offered at the most is not half as sure
        assert largest_sd(at, 32) > 4.0
