"""Monte Carlo: stated intervals hold what they promise, and no information is lost."""

import numpy as np
import pytest

from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.sensitivity import prediction_sd
from benchmarks.sources.campaigns import Rows
from tests.support.compcore.fit_cases import (
    GEOMETRY,
    bridge,
    model,
    plane_rows,
    random_theta,
    somewhere,
    with_truth,
)

REPEATS = 400


@pytest.fixture(scope="module")
def experiments():
    """Predictions and their stated uncertainty of many fits of the same machine."""
    rng = np.random.default_rng(5)
    rows = Rows(("X", "Y", "Z"))
    plane_rows(rows)
    empty = rows.campaign("plane")
    wanted = model(bridge(), *GEOMETRY)
    theta = random_theta(wanted, empty, rng)
    places = somewhere(rng, 12)
    problem = Problem(wanted, empty)
    values = problem.layout.values(theta, np.zeros(len(theta)))
    true = wanted.with_values(values).predict(places).translation
    errors, stated, chi2, raw = [], [], [], []
    for _ in range(REPEATS):
        result = fit(wanted, with_truth(wanted, empty, theta, rng))
        off = result.model.predict(places).translation - true
        errors.append(_in_the_plane(off, places))
        stated.append(_stated(result.model, places))
        chi2.append(result.chi2)
        raw.append((off, prediction_sd(result.model, places)[0]))
    return np.array(errors), np.array(stated), np.array(chi2), result.dof, np.array(raw)


def _columns(places) -> np.ndarray:
    """What a displaced frame does to X and Y at the places: (2n, 3)."""
    x, y = places.position("X"), places.position("Y")
    zero, one = np.zeros_like(x), np.ones_like(x)
    along_x = np.stack([one, zero, -y], axis=1)
    along_y = np.stack([zero, one, x], axis=1)
    return np.concatenate([along_x, along_y])


def _free(places) -> np.ndarray:
    """Combinations of X and Y errors that no displacement of the frame changes: (2n − 3, 2n)."""
    u, _, _ = np.linalg.svd(_columns(places), full_matrices=True)
    return u[:, 3:].T


def _in_the_plane(error: np.ndarray, places) -> np.ndarray:
    return _free(places) @ np.concatenate([error[:, 0], error[:, 1]])


def _stated(fitted, places) -> np.ndarray:
    from abbe.compcore.model.sensitivity import sensitivities

    moved, _ = sensitivities(fitted, places)
    both = _free(places) @ np.concatenate([moved[:, 0], moved[:, 1]])
    return np.sqrt(np.einsum("np,pq,nq->n", both, fitted.covariance, both))


@pytest.mark.thorough
def test_intervals_of_95_percent_cover_95_percent(experiments) -> None:
    errors, stated, _, _, _ = experiments
    covered = np.abs(errors) <= 1.96 * stated
    assert 0.93 < covered.mean() < 0.97
    # every single combination too, within what 400 repeats can tell
    assert covered.mean(axis=0).min() > 0.90


def test_predictions_in_the_chosen_frame_cover_95_percent_too(experiments) -> None:
    *_, raw = experiments
    off, sd = raw[:, 0, :, :2], raw[:, 1, :, :2]
    # the truth's own frame differs from the fit's by what never changes: its mean over repeats
    apart = off - off.mean(axis=0)
    assert 0.93 < (np.abs(apart) <= 1.96 * sd).mean() < 0.97


def test_no_information_is_lost_against_the_cramer_rao_bound(experiments) -> None:
    errors, *_ = experiments
    bound = _bound()
    free = _free(somewhere_again())
    # generalised variance over the bound's, direction by direction of the bound's own axes
    values, vectors = np.linalg.eigh(free @ bound @ free.T)
    seen = values > 1e-6 * values.max()
    spread = (errors @ vectors[:, seen]) ** 2 / values[seen]
    # the mean of χ²-distributed numbers: 400 repeats × 15 directions know it to 2 %
    assert spread.mean() == pytest.approx(1.0, abs=0.05)


def somewhere_again():
    rng = np.random.default_rng(5)
    rows = Rows(("X", "Y", "Z"))
    plane_rows(rows)
    random_theta(model(bridge(), *GEOMETRY), rows.campaign("plane"), rng)
    return somewhere(rng, 12)


def _bound() -> np.ndarray:
    """Cramér–Rao bound of the predictions by a dense pseudo-inverse."""
    rows = Rows(("X", "Y", "Z"))
    plane_rows(rows)
    wanted, places = model(bridge(), *GEOMETRY), somewhere_again()
    problem = Problem(wanted, rows.campaign("plane"))
    dense = problem.jacobian(problem.start())
    size = np.linalg.norm(dense, axis=0)
    inverse = np.linalg.pinv((dense / size).T @ (dense / size), rcond=1e-12)
    covariance = inverse / np.outer(size, size)
    m = problem.layout.size
    at = np.zeros((24, m))
    for k in range(m):
        one = np.zeros(m)
        one[k] = 1.0
        values = problem.layout.values(one, np.zeros(m))
        error = wanted.with_values(values).predict(places).translation
        at[:, k] = np.concatenate([error[:, 0], error[:, 1]])
    return at @ covariance[:m, :m] @ at.T


def test_chi2_has_its_degrees_of_freedom(experiments) -> None:
    _, _, chi2, dof, _ = experiments
    assert chi2.mean() == pytest.approx(dof, abs=4.0 * np.sqrt(2.0 * dof / REPEATS))


def test_a_prediction_that_nothing_determines_is_uncertain_by_the_plausible_range() -> None:
    rng = np.random.default_rng(1)
    rows = Rows(("X", "Y", "Z"))
    plane_rows(rows)
    wanted = model(bridge(), *GEOMETRY, "positioning axis=Z shape=polynomial:1")
    result = fit(wanted, rows.campaign("plane"))
    (combination,) = [u for u in result.undetermined if not u.convention]
    assert combination.effects == ("positioning axis=Z shape=polynomial:1",)
    places = somewhere(rng)
    sd, _ = prediction_sd(result.model, places)
    far = np.abs(places.position("Z") + 180.0) > 90.0
    assert sd[far, 2].min() > 50e-3
    assert sd[:, :2].max() < 2e-3
