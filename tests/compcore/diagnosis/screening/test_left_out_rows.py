"""Rows that are left out of a fit: against fits without them, whatever joined the model."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.diagnosis.screening.projection.left_out_rows import ALONE, LeftOutRows

N, LEFT = 60, 12


def columns(seed: int, *, own: int = 0, faint: float = 0.0) -> np.ndarray:
    """Columns over all rows; `own` of them on the left-out rows only, but for a `faint` rest."""
    rng = np.random.default_rng(seed)
    found = rng.normal(size=(N, 5 + own))
    found[LEFT:, 5:] *= faint
    return found


def refitted(design: np.ndarray, readings: np.ndarray) -> np.ndarray:
    """What a fit to the other rows leaves of the left-out ones, nothing alone in them."""
    fitted = np.linalg.lstsq(design[LEFT:], readings[LEFT:], rcond=None)[0]
    return readings[:LEFT] - design[:LEFT] @ fitted


def asked(model: np.ndarray, more: np.ndarray, readings: np.ndarray):
    q = np.linalg.qr(model)[0]
    extra = more - q @ (q.T @ more)
    extra = np.linalg.qr(extra)[0]
    whole = np.hstack([q, extra])
    residual = readings - whole @ (whole.T @ readings)
    return LeftOutRows(q[:LEFT]).foretold(extra[:LEFT], residual[:LEFT])


@pytest.mark.parametrize("joined", [0, 1, 4])
def test_a_fit_without_the_rows_foretells_them(joined: int):
    model, more = columns(1), columns(2)[:, :joined]
    readings = np.random.default_rng(3).normal(size=N)
    left, alone = asked(model, more, readings)
    assert alone == 0
    np.testing.assert_allclose(left, refitted(np.hstack([model, more]), readings), rtol=1e-9)


@pytest.mark.parametrize("faint", [0.0, 0.01], ids=["wholly", "nearly"])
def test_what_the_rows_alone_show_is_fitted_to_them(faint: float):
    model, more = columns(1, own=2, faint=faint), columns(2)[:, :3]
    readings = np.random.default_rng(3).normal(size=N)
    left, alone = asked(model, more, readings)
    assert alone == 2
    # exactly: I − H_BB of all columns inverted, but for what the rows alone determine
    q = np.linalg.qr(np.hstack([model, more]))[0]
    residual = readings - q @ (q.T @ readings)
    keep, v = np.linalg.eigh(np.eye(LEFT) - q[:LEFT] @ q[:LEFT].T)
    told = keep >= ALONE
    wanted = v[:, told] @ ((v[:, told].T @ residual[:LEFT]) / keep[told])
    np.testing.assert_allclose(left, wanted, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("faint", [0.0, 0.01], ids=["wholly", "nearly"])
def test_what_joins_may_be_shown_by_the_rows_alone(faint: float):
    model, more = columns(1), columns(2, own=1, faint=faint)[:, 3:]
    readings = np.random.default_rng(3).normal(size=N)
    left, alone = asked(model, more, readings)
    assert alone == 1
    q = np.linalg.qr(np.hstack([model, more]))[0]
    residual = readings - q @ (q.T @ readings)
    keep, v = np.linalg.eigh(np.eye(LEFT) - q[:LEFT] @ q[:LEFT].T)
    told = keep >= ALONE
    wanted = v[:, told] @ ((v[:, told].T @ residual[:LEFT]) / keep[told])
    np.testing.assert_allclose(left, wanted, rtol=1e-8, atol=1e-10)
