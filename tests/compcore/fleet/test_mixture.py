"""Which machines have a cause: against numerical integration, and simulated fleets."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate

from abbe.compcore.fleet.mixture import ToldOfCause, mixture


def told(value: float, sd: float) -> ToldOfCause:
    return ToldOfCause(np.array([[sd**-2]]), np.array([value * sd**-2]))


def fleet(rng: np.random.Generator, having: int, without: int, size: float) -> list[ToldOfCause]:
    truth = [size] * having + [0.0] * without
    sds = rng.uniform(0.7, 1.4, len(truth))
    return [told(float(rng.normal(t, s)), float(s)) for t, s in zip(truth, sds, strict=True)]


def test_the_likelihood_is_the_one_that_is_integrated_numerically() -> None:
    machines = fleet(np.random.default_rng(5), 4, 5, 4.0)
    found = mixture(machines)
    mean, tau = float(found.mean[0]), float(np.sqrt(found.variances[0]))
    total = 0.0
    for m in machines:
        information, weighted = float(m.information[0, 0]), float(m.weighted[0])

        def joint(a: float, i: float = information, w: float = weighted) -> float:
            prior = np.exp(-0.5 * ((a - mean) / tau) ** 2) / (tau * np.sqrt(2.0 * np.pi))
            return float(np.exp(w * a - 0.5 * i * a * a) * prior)

        factor, _ = integrate.quad(joint, mean - 12 * tau, mean + 12 * tau, limit=400)
        total += 2.0 * np.log1p(found.part * (factor - 1.0))
    assert found.gain == pytest.approx(total, rel=1e-6)
    assert found.gain == pytest.approx(float(found.gains.sum()))


def test_five_of_twelve_that_none_shows_alone() -> None:
    """Three times its noise each: together beyond doubt, and said of the right ones."""
    rng = np.random.default_rng(2)
    right = wrong = 0
    for _ in range(20):
        found = mixture(fleet(rng, 5, 7, 3.5))
        assert found.gain > 12.0
        right += int((found.chances[:5] > 0.5).sum())
        wrong += int((found.chances[5:] > 0.5).sum())
    assert right >= 80
    assert wrong <= 20


def test_noise_gains_little() -> None:
    rng = np.random.default_rng(4)
    gains = [mixture(fleet(rng, 0, 12, 0.0)).gain for _ in range(30)]
    assert np.median(gains) < 2.0
    assert max(gains) < 15.0


def test_units_do_not_matter_and_parameters_hang_together() -> None:
    rng = np.random.default_rng(6)
    shear = np.array([[1.0, 0.9], [0.0, 0.4]])
    information = shear.T @ shear
    machines = []
    for k in range(8):
        a = np.array([3.0, -2.0]) if k < 4 else np.zeros(2)
        value = a + np.linalg.solve(shear, rng.standard_normal(2))
        machines.append(ToldOfCause(information, information @ value))
    found = mixture(machines)
    units = np.array([1e3, 1e-6])
    other = mixture(
        [ToldOfCause(m.information / np.outer(units, units), m.weighted / units) for m in machines]
    )
    assert other.gain == pytest.approx(found.gain, rel=1e-2)
    assert other.mean / units == pytest.approx(found.mean, rel=5e-2)
    assert other.chances == pytest.approx(found.chances, abs=5e-2)


def test_a_price_for_what_was_searched_is_paid_by_those_that_have_it() -> None:
    machines = fleet(np.random.default_rng(9), 5, 7, 5.0)
    dear = [ToldOfCause(m.information, m.weighted, 4.0) for m in machines]
    assert mixture(dear).gain < mixture(machines).gain - 10.0
