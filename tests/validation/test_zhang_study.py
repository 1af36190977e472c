"""Zhang's calibration: squareness, thermal scales, lines, gauge block, error map."""

import numpy as np
import pytest

from benchmarks.sources import zhang


@pytest.fixture(scope="module")
def study() -> zhang.Study:
    return zhang.run(1)


def test_noise_is_all_that_is_left(study: zhang.Study) -> None:
    assert study.result.chi2_per_dof == pytest.approx(1.0, abs=0.06)
    assert all(u.convention for u in study.result.undetermined)


def test_squareness_from_opposite_diagonals_within_half_a_microradian(study: zhang.Study) -> None:
    for true, found, sd in study.squareness.values():
        assert abs(found - true) < 0.5e-6
        assert sd < 0.3e-6


def test_effective_expansion_coefficients_come_back(study: zhang.Study) -> None:
    for axis, (alpha, sd) in study.expansion.items():
        assert abs(alpha - zhang.ALPHA[axis]) < 0.3e-6
        assert sd < 0.2e-6


def test_more_than_fifty_lines_improve_in_both_parts(study: zhang.Study) -> None:
    lines = study.lines.lines
    assert len(lines) > 50
    linear = np.array([[line.linear_before, line.linear_after] for line in lines])
    rest = np.array([[line.rest_before, line.rest_after] for line in lines])
    before, after = np.abs(linear).max(axis=0)
    assert before > 10e-3
    assert after < 1.5e-3
    assert rest[:, 1].mean() < 0.75 * rest[:, 0].mean()
    assert study.lines.lengths.chi2_per_dof < 1.25


def test_the_gauge_block_in_seven_orientations(study: zhang.Study) -> None:
    assert len(study.block) == 7
    before = max(abs(b) for _, b, _ in study.block)
    after = max(abs(a) for _, _, a in study.block)
    assert before > 7.0
    assert after < 1.4


def test_the_worst_pair_of_a_plane_is_predicted(study: zhang.Study) -> None:
    for plane in study.plane.values():
        worst = plane.true[2]
        assert abs(worst) > 10e-3
        assert plane.predicted == pytest.approx(worst, abs=1.5e-3)
        assert abs(plane.left) < 0.15 * abs(worst)
