"""Uncertainty budgets of ISO 230-2's figures: by hand, and against tests done again at random."""

from math import hypot, sqrt

import numpy as np
import pytest

from abbe.compcore.iso230.positioning import Runs, evaluate_positioning
from abbe.compcore.verification.budget import (
    FIGURES,
    MeasuringUncertainty,
    budgets_of,
    combined,
)
from tests.support.daemon.verified_line import DOWN, UP

LINE = Runs("x", "X", "mm", np.array([0.0, 100.0, 200.0]), 1e-3 * np.array(UP),
            1e-3 * np.array(DOWN))  # fmt: skip
"""Extremes: 1 µm at 0 (↑, s = 1) and 10 µm at 200 (↓, s = 0.5), three runs."""


def test_what_grows_along_the_line_is_in_what_lies_at_its_ends():
    """E, A: from the first to the last target, all of it; M likewise; R, B: nothing of it."""
    found = budgets_of(LINE, {"instrument": 4e-4}, 3e-4)
    assert set(found) == set(FIGURES)
    for name in ("A", "E", "M"):
        assert found[name]["instrument"] == pytest.approx(4e-4), name
    for name in ("R", "B"):
        assert found[name]["instrument"] == pytest.approx(0.0, abs=1e-15), name


def test_the_means_of_three_runs_by_hand():
    """E and A: √(1/3 + 0.25/3); M: means of both, √(1/3 + 1/3 + 1/3 + 0.25/3)/2."""
    found = budgets_of(LINE, {}, 3e-4)
    for name in ("A", "E"):
        assert found[name]["repeatability"] == pytest.approx(1e-3 * sqrt(1.25 / 3.0)), name
    assert found["M"]["repeatability"] == pytest.approx(0.5e-3 * sqrt(3.25 / 3.0))


def test_targets_that_were_read_once_are_as_sure_as_a_reading():
    once = Runs("x", "X", "mm", LINE.targets, LINE.up[:, :1], LINE.down[:, :1])
    found = budgets_of(once, {}, 3e-4)
    assert set(found) == {"E", "M", "B"}
    assert found["E"]["repeatability"] == pytest.approx(3e-4 * sqrt(2.0))


def test_lengths_by_hand():
    """1000 mm at 22 °C: 0.5 µm/m; 11.5 ppm/K · 0.2 K and 1 ppm/K · 2 K; 0.5²/2000/√12."""
    found = MeasuringUncertainty().of_length(1000.0, 22.0)
    assert found["instrument"] == pytest.approx(0.5e-3)
    assert found["thermal expansion"] == pytest.approx(hypot(2.3e-3, 2.0e-3))
    assert found["set-up"] == pytest.approx(0.25 / 2000.0 / sqrt(12.0))
    assert combined(found) == pytest.approx(
        sqrt(0.5e-3**2 + 2.3e-3**2 + 2e-3**2 + (0.25 / 2000.0) ** 2 / 12.0)
    )
    half = MeasuringUncertainty().of_length(500.0, 22.0, 1000.0)
    for cause, u in found.items():
        assert half[cause] == pytest.approx(0.5 * u), cause


def test_cosine_errors_drawn_at_random_scatter_as_stated():
    """A beam that ends anywhere up to 5 mm beside a line of 400 mm, its cosine error uniform."""
    rng = np.random.default_rng(14253)
    error = rng.uniform(0.0, 25.0 / 800.0, 200_000)
    stated = MeasuringUncertainty(misalignment=5.0).of_length(400.0, None)["set-up"]
    assert np.std(error) == pytest.approx(stated, rel=0.01)
    assert 400.0 - sqrt(400.0**2 - 25.0) == pytest.approx(25.0 / 800.0, rel=1e-3)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", ["E", "M", "A"])
def test_a_test_done_again_with_another_scale_and_other_means_scatters_as_stated(name):
    """A long line with an error of 40 µm; scales and means drawn at random."""
    rng = np.random.default_rng(230)
    x = np.linspace(0.0, 1000.0, 11)
    n, s, scale = 5, 0.8e-3, 1.2e-3
    form = 40e-6 * x + 1e-3 * np.sin(x / 90.0)
    noise = rng.standard_normal((2, 11, n))
    noise = s * (noise - noise.mean(2, keepdims=True)) / noise.std(2, ddof=1, keepdims=True)

    def line(shift, mean):
        up = form[:, None] + noise[0] + (shift * x / 1000.0 + mean[0])[:, None]
        down = form[:, None] + 2e-3 + noise[1] + (shift * x / 1000.0 + mean[1])[:, None]
        return Runs("x", "X", "mm", x, up, down)

    stated = combined(budgets_of(line(0.0, np.zeros((2, 11))), {"instrument": scale}, 3e-4)[name])
    drawn = [
        getattr(
            evaluate_positioning(
                line(scale * rng.standard_normal(), s / sqrt(n) * rng.standard_normal((2, 11)))
            ),
            name,
        )
        for _ in range(3000)
    ]
    assert np.std(drawn) == pytest.approx(stated, rel=0.08)
