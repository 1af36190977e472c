"""Two causes together: the fall of χ² from their inner products, against plain least squares."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.diagnosis.screening.projection.falls import drops_together

ROWS = 40


@pytest.mark.parametrize(("wide", "narrow"), [(1, 1), (4, 1), (3, 3), (7, 4)])
@pytest.mark.parametrize("shared", [0, 1])
def test_two_causes_together_explain_what_least_squares_with_both_does(
    wide: int, narrow: int, shared: int
) -> None:
    rng = np.random.default_rng(wide + 10 * narrow)
    cross, one, other, expected = [], [], [], []
    for _ in range(5):
        a = np.linalg.qr(rng.normal(size=(ROWS, wide)))[0]
        b = rng.normal(size=(ROWS, narrow))
        b[:, :shared] = a[:, :shared]
        b = np.linalg.qr(b)[0]
        residual = rng.normal(size=ROWS)
        fitted = np.hstack([a, b]) @ np.linalg.lstsq(np.hstack([a, b]), residual, rcond=1e-6)[0]
        expected.append(fitted @ fitted)
        cross.append(a.T @ b)
        one.append(a.T @ residual)
        other.append(b.T @ residual)
    drop, rank = drops_together(np.array(cross), np.array(one), np.array(other), 1e-4)
    np.testing.assert_allclose(drop, expected, rtol=1e-9)
    assert rank.tolist() == [wide + narrow - shared] * 5
