"""A tracker that stands turned by degrees, before an arm whose joints lie 10 mm elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from abbe.compcore.campaign.campaign import Campaign, Setup
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from tests.support.compcore.arm_points import PLACES, campaign_of, tips

F64 = NDArray[np.float64]


def turned_by(angle: float, noise: float = 0.0) -> tuple[Model, Campaign, F64]:
    """60 poses of an arm, two trackers turned by an angle each; errors known; value in mm."""
    rng = np.random.default_rng(4)
    q = rng.uniform(-1.3, 1.3, (60, len(PLACES)))
    errors = np.hstack([rng.uniform(-5.0, 5.0, (6, 3)), rng.uniform(-0.03, 0.03, (6, 3))])
    tool = np.where(np.arange(60)[:, None] % 2, [900.0, 40.0, 1332.0], [950.0, -60.0, 1400.0])
    nominal, seen = tips(q, tool), tips(q, tool, errors)
    second = np.arange(60) >= 30
    for rows, turn in ((~second, [1.0, -0.5, 0.7]), (second, [-0.6, 0.8, 1.0])):
        rigid = Rotation.from_rotvec(angle * np.array(turn))
        seen[rows] = np.array([3.0, -2.0, 5.0]) + rigid.apply(seen[rows])
    seen += rng.normal(0.0, noise, seen.shape)
    model, campaign = campaign_of(q, tool, seen - nominal, second)
    return model, campaign, seen - nominal


@pytest.mark.parametrize("angle", [0.001, 0.05])
def test_what_the_joints_do_is_found_however_the_instrument_stands(angle: float) -> None:
    model, campaign, _ = turned_by(angle)
    result = fit(model, campaign)
    # of errors of centimetres, read to 20 µm; with the lever rule, or a small frame, 1 mm was
    assert float(np.abs(result.residual).max()) < 1e-4


def test_its_standing_is_reported_in_full() -> None:
    model, campaign, _ = turned_by(0.05)
    first, second = (fit(model, campaign).nuisances[s] for s in ("one", "two"))
    # each by the same frame more, which the arm's own foot is free to take
    one, two = (Rotation.from_rotvec([s[f"frame {k}"][0] for k in "abc"]) for s in (first, second))
    expected = (
        Rotation.from_rotvec([0.05, -0.025, 0.035])
        * Rotation.from_rotvec([-0.03, 0.04, 0.05]).inv()
    )
    np.testing.assert_allclose((one * two.inv()).as_matrix(), expected.as_matrix(), atol=1e-8)


def test_slopes_are_those_of_what_is_left() -> None:
    model, campaign, _ = turned_by(0.05, noise=0.05)
    problem = Problem(model, campaign)
    theta = (
        fit(model, campaign).theta
        + np.random.default_rng(1).normal(0.0, 0.1, problem.layout.size) * problem.layout.scale
    )
    left = problem.eliminator(theta).project(problem.columns(theta))

    def residual(at: F64) -> F64:
        return problem.eliminator(theta).project(problem.residual(at))

    for k in range(0, problem.layout.size, 3):
        step = np.zeros(problem.layout.size)
        step[k] = 1e-3 * problem.layout.scale[k]
        slope = (residual(theta - step) - residual(theta + step)) / (2.0 * step[k])
        size = float(np.linalg.norm(left[:, k]))
        if size > 1e-6 / problem.layout.scale[k]:
            assert float(np.linalg.norm(slope - left[:, k])) < 1e-3 * size


def test_rows_in_parts_see_the_same_instrument() -> None:
    model, campaign, _ = turned_by(0.05, noise=0.05)
    problem = Problem(model, campaign)
    theta = fit(model, campaign).theta
    rows = np.arange(7, 120, 3)
    part = problem.part(rows, theta)
    np.testing.assert_allclose(part.predicted(theta), problem.predicted(theta)[rows], atol=1e-9)
    np.testing.assert_allclose(part.columns(theta), problem.columns(theta)[rows], rtol=1e-9)


def test_a_frame_that_is_known_is_not_turned() -> None:
    model, campaign, _ = turned_by(0.0)
    known = replace(campaign, setups={name: Setup(name, ()) for name in campaign.setups})
    assert Problem(model, known).frames(Problem(model, known).start()) is None


def test_errors_that_add_up_keep_small_frames() -> None:
    model, campaign, _ = turned_by(0.05)
    plain = Problem(replace(model, composition="first-order"), campaign)
    assert plain.frames(plain.start()) is None
