"""Average run lengths of control charts, against published tables, closed forms and simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from abbe.compcore.monitoring.run_length import (
    cusum_limit,
    cusum_run_length,
    ewma_limit,
    ewma_run_length,
)

SHIFTS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0)

LUCAS_AND_SACCUCCI = {
    (0.4, 3.054): (500, 224, 71.2, 28.4, 14.3, 5.9, 3.5, 2.5, 2.0, 1.4),
    (0.25, 2.998): (500, 170, 48.2, 20.1, 11.1, 5.5, 3.6, 2.7, 2.3, 1.7),
    (0.2, 2.962): (500, 150, 41.8, 18.2, 10.5, 5.5, 3.7, 2.9, 2.4, 1.9),
    (0.1, 2.814): (500, 106, 31.3, 15.9, 10.3, 6.1, 4.4, 3.4, 2.9, 2.2),
    (0.05, 2.615): (500, 84.1, 28.8, 16.4, 11.4, 7.1, 5.2, 4.2, 3.5, 2.7),
}
"""(weight, limit) → run lengths at `SHIFTS`. J. M. Lucas and M. S. Saccucci, Technometrics 32
(1990), 1, table 3; Montgomery, Introduction to Statistical Quality Control, table 9.11."""

MONTGOMERY = {
    (0.5, 4.0): (168, 74.2, 26.6, 13.3, 8.38, 4.75, 3.34, 2.62, 2.19, 1.71),
    (0.5, 5.0): (465, 139, 38.0, 17.0, 10.4, 5.75, 4.01, 3.11, 2.57, 2.01),
}
"""(reference, limit) → run lengths at `SHIFTS`. Montgomery, table 9.3, after Lucas and Crosier."""

HAWKINS = {0.25: 8.01, 0.5: 4.77, 0.75: 3.34, 1.0: 2.52, 1.25: 1.99, 1.5: 1.61}
"""Reference → limit for a run length of 370. D. M. Hawkins, Journal of Quality Technology 25
(1993), 248; Montgomery, table 9.4."""


def _digits(published: float) -> float:
    """A unit of the last printed digit: the tables come from Markov chains of finite steps."""
    text = f"{published:g}"
    decimals = len(text.partition(".")[2])
    return 10.0**-decimals


@pytest.mark.parametrize(("design", "lengths"), LUCAS_AND_SACCUCCI.items())
def test_ewma_as_published(design: tuple[float, float], lengths: tuple[float, ...]) -> None:
    for shift, published in zip(SHIFTS, lengths, strict=True):
        assert ewma_run_length(*design, shift) == pytest.approx(published, abs=_digits(published))


@pytest.mark.parametrize(("design", "lengths"), MONTGOMERY.items())
def test_cusum_as_published(design: tuple[float, float], lengths: tuple[float, ...]) -> None:
    for shift, published in zip(SHIFTS, lengths, strict=True):
        assert cusum_run_length(*design, shift) == pytest.approx(published, abs=_digits(published))


@pytest.mark.parametrize(("reference", "limit"), HAWKINS.items())
def test_limits_of_the_cusum_as_published(reference: float, limit: float) -> None:
    assert cusum_limit(reference, 370.0) == pytest.approx(limit, abs=0.006)


@pytest.mark.parametrize("design", LUCAS_AND_SACCUCCI)
def test_limits_of_the_ewma_as_published(design: tuple[float, float]) -> None:
    assert ewma_limit(design[0], 500.0) == pytest.approx(design[1], abs=6e-4)


@pytest.mark.parametrize("limit", [2.0, 3.0, 3.5, 4.5])
@pytest.mark.parametrize("shift", [0.0, 1.0, 3.0])
def test_a_weight_of_one_is_shewharts_chart(limit: float, shift: float) -> None:
    within = 0.5 * math.erfc(-(limit - shift) / math.sqrt(2.0)) - 0.5 * math.erfc(
        (limit + shift) / math.sqrt(2.0)
    )
    assert ewma_run_length(1.0, limit, shift) == pytest.approx(1.0 / (1.0 - within), rel=1e-8)


@pytest.mark.parametrize(("reference", "limit"), [(0.5, 5.0), (0.25, 8.0), (0.5, 9.0)])
@pytest.mark.parametrize("shift", [0.0, 0.5, 1.0])
def test_cusum_near_siegmunds_approximation(reference: float, limit: float, shift: float) -> None:
    def one_sided(drift: float) -> float:
        b = limit + 1.166
        if abs(drift) < 1e-9:
            return b * b
        return (math.exp(-2.0 * drift * b) + 2.0 * drift * b - 1.0) / (2.0 * drift**2)

    near = 1.0 / (1.0 / one_sided(shift - reference) + 1.0 / one_sided(-shift - reference))
    assert cusum_run_length(reference, limit, shift) == pytest.approx(near, rel=0.05)


def _simulated(count: int, shift: float, chart: str, made: float, limit: float) -> np.ndarray:
    """Run lengths of charts that are led value by value, apart from all equations."""
    rng = np.random.default_rng(5)
    lengths = np.zeros(count)
    a, b = np.zeros(count), np.zeros(count)
    alive = np.arange(count)
    while alive.size:
        z = rng.normal(shift, 1.0, alive.size)
        lengths[alive] += 1
        if chart == "ewma":
            a[alive] += made * (z - a[alive])
            out = np.abs(a[alive]) > limit * math.sqrt(made / (2.0 - made))
        else:
            a[alive] = np.maximum(0.0, a[alive] + z - made)
            b[alive] = np.maximum(0.0, b[alive] - z - made)
            out = np.maximum(a[alive], b[alive]) > limit
        alive = alive[~out]
    return lengths


@pytest.mark.parametrize(("chart", "made"), [("ewma", 0.1), ("cusum", 1.0)])
@pytest.mark.parametrize("shift", [0.0, 1.5])
def test_simulated_charts_run_as_long(chart: str, made: float, shift: float) -> None:
    find, length = (
        (ewma_limit, ewma_run_length) if chart == "ewma" else (cusum_limit, cusum_run_length)
    )
    limit = find(made, 300.0)
    runs = _simulated(4000, shift, chart, made, limit)
    error = runs.std() / math.sqrt(runs.size)
    assert abs(runs.mean() - length(made, limit, shift)) < 4.0 * error


@pytest.mark.parametrize("wanted", [5.0, 20.0, 1e4, 1e6])
def test_limits_have_the_run_length_asked_for(wanted: float) -> None:
    assert ewma_run_length(0.1, ewma_limit(0.1, wanted)) == pytest.approx(wanted, rel=1e-5)
    assert cusum_run_length(1.0, cusum_limit(1.0, wanted)) == pytest.approx(wanted, rel=1e-5)


def test_a_shift_counts_alike_in_both_directions() -> None:
    assert ewma_run_length(0.2, 3.0, 1.0) == pytest.approx(ewma_run_length(0.2, 3.0, -1.0))
    assert cusum_run_length(0.5, 4.0, 1.0) == pytest.approx(cusum_run_length(0.5, 4.0, -1.0))


@pytest.mark.parametrize(
    "bad",
    [
        lambda: ewma_run_length(0.0, 3.0),
        lambda: ewma_run_length(1.1, 3.0),
        lambda: ewma_run_length(0.1, -1.0),
        lambda: cusum_run_length(-0.1, 3.0),
        lambda: cusum_run_length(0.5, math.nan),
        lambda: ewma_limit(0.1, 1.0),
        lambda: cusum_limit(0.5, math.inf),
        lambda: cusum_limit(1.0, 3.0),  # a value in three is beyond one standard deviation
    ],
)
def test_designs_that_are_none_are_refused(bad) -> None:
    with pytest.raises(ValueError, match="expected"):
        bad()
