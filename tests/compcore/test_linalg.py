"""The singular value decomposition when LAPACK's fast algorithm gives up."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.linalg import svd


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("shape", [(7, 4), (4, 7)])
def test_the_slower_algorithm_takes_over(monkeypatch, full, shape):
    a = np.random.default_rng(1).normal(size=shape)
    fast = svd(a, full=full)

    def gives_up(*_: object, **__: object) -> None:
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", gives_up)
    slow = svd(a, full=full)
    assert slow.u.shape == fast.u.shape
    assert slow.vt.shape == fast.vt.shape
    assert slow.s == pytest.approx(fast.s)
    k = min(shape)
    assert slow.u[:, :k] * slow.s @ slow.vt[:k] == pytest.approx(a)


def test_numbers_that_are_not_finite_are_refused(monkeypatch):
    with pytest.raises(ValueError, match=r"infs or NaNs|not converge"):
        svd(np.array([[1.0, np.nan], [0.0, 1.0]]))
