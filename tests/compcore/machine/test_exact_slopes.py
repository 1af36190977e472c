"""Derivatives of the exact error, against differences of the exact error itself."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.effects import ErrorMotion
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.exact_slopes import ExactSlopes
from abbe.compcore.machine.kinematics import Chain, exact
from tests.support.compcore.machines import machine

STEP = 1e-6
CODES = ["w b Y X Z t", "w C' A' b X Y Z t", "w b C1 B2 B3 C4 t"]


def half_skew(orientation: np.ndarray) -> np.ndarray:
    skew = 0.5 * (orientation - np.swapaxes(orientation, 1, 2))
    return np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)


@pytest.mark.parametrize("code", CODES)
def test_slopes_are_those_of_the_exact_error_for_turns_of_ten_degrees(code: str) -> None:
    owner, rng = machine(code), np.random.default_rng(5)
    at = {a: rng.uniform(-1.0, 1.0, 4) for a in owner.structure.axes}
    chain = Chain(owner, Conditions(at, tool=rng.uniform(-200.0, 200.0, (4, 3))))
    motions = {
        ErrorMotion(place, k): rng.uniform(-0.2, 0.2, 4)
        for place in owner.structure.axes[:-1]
        for k in "XYZABC"
    }
    slopes = ExactSlopes(chain, motions)
    np.testing.assert_allclose(slopes.orientation, exact(chain, motions)[1], atol=1e-12)
    # of the last axis nothing is known, and a little of it moves the tool all the same
    for place in owner.structure.axes:
        for k in "XYZABC":
            asked = ErrorMotion(place, k)
            here = motions.get(asked, np.zeros(4))
            ends = [exact(chain, {**motions, asked: here + s * STEP}) for s in (1.0, -1.0)]
            moved, turned = slopes.influence(asked)
            expected = (ends[0][0] - ends[1][0]) / (2.0 * STEP)
            np.testing.assert_allclose(moved, expected, atol=1e-5, rtol=1e-6)
            expected = (half_skew(ends[0][1]) - half_skew(ends[1][1])) / (2.0 * STEP)
            np.testing.assert_allclose(turned, expected, atol=1e-7)
