"""Zhang's calibration: squareness, thermal scales, lines, gauge block, error map."""

import json
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.files.model_file import save_model
from benchmarks.sources import zhang
from tests.support.daemon.command_line import abbe


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


@pytest.mark.thorough
def test_his_error_maps_by_the_command(study: zhang.Study, tmp_path: Path) -> None:
    """The plane at 20 and 19 °C: lengths between all points, against the exact chain."""
    model = tmp_path / "zhang.toml"
    save_model(study.result.model, model)
    probe = ",".join(f"{v:g}" for v in zhang.PROBE)
    done = abbe(
        "error-map", model, "Z=-330", f"tool={probe}", "--temperature", "20,19",
        "--range", "X=0,700", "--range", "Y=0,900", "--points", "10", "--json",
    )  # fmt: skip
    assert done.status == 0, done.err
    answer = json.loads(done.out)
    x, y = (g.ravel() for g in np.meshgrid(answer["grid"]["X"], answer["grid"]["Y"], indexing="ij"))
    places = np.stack([x, y, np.full(x.shape, -330.0)], axis=1)
    apart = places[:, None] - places[None]
    length = np.linalg.norm(apart, axis=2) + np.eye(len(x))
    positions = dict(zip("XYZ", places.T, strict=True))
    largest = []
    for one, warmth in zip(answer["maps"], (20.0, 19.0), strict=True):
        warm = {name: np.full(len(x), warmth) for name in study.result.model.machine.signals}
        true = zhang.machine().error({**positions, **warm}, zhang.PROBE) * 1e3
        said = np.array(one["error"]).reshape(-1, 3)

        def of_lengths(error: np.ndarray) -> np.ndarray:
            return np.einsum("ijk,ijk->ij", apart, error[:, None] - error[None]) / length

        largest.append(float(np.abs(of_lengths(true)).max()))
        assert abs(one["worst_pair"]["length_error"]) == pytest.approx(largest[-1], abs=1.5)
        assert np.abs(of_lengths(said - true)).max() < 2.0
    assert largest[1] > largest[0] + 5.0
