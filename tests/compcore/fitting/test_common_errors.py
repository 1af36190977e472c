"""Rows that share a gauge's error, against dense least squares with the full covariance matrix."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.join import join_campaigns
from abbe.compcore.diagnosis.screening.projection.bank import screen
from abbe.compcore.diagnosis.screening.projection.basis import Basis
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign, write_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.fitting.design import row_blocks
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.fitting.reduction import leverage
from tests.compcore.fitting.test_design_matrix import plane
from tests.support.compcore.campaign_texts import CMM, GOOD, read_text
from tests.support.daemon.command_line import abbe


def gauged(seed: int = 0) -> tuple[object, Campaign]:
    """A plane of lines; a third of the rows against gauge A, a third against B, of many sizes."""
    wanted, campaign, _ = plane("zero", seed=seed)
    rng = np.random.default_rng(seed + 50)
    gauge = rng.choice(["", "A", "B"], campaign.n)
    size = np.where(gauge == "", 0.0, campaign.sd * rng.uniform(0.1, 8.0, campaign.n))
    off = np.where(gauge == "A", 2.0, -1.5) * size
    return wanted, replace(campaign, value=campaign.value + off, gauge=gauge, gauge_sd=size)


def covariance(campaign: Campaign) -> np.ndarray:
    """Σ of all rows, written out."""
    sigma = np.diag(campaign.sd**2)
    for name in ("A", "B"):
        c = np.where(campaign.gauge == name, campaign.gauge_sd, 0.0)
        sigma += np.outer(c, c)
    return sigma


def dense(result: FitResult, campaign: Campaign, more: np.ndarray | None = None):
    """Generalised least squares: solution, covariance, χ² and residual; nuisances as columns."""
    problem = result.problem
    theta = problem.start()
    columns = problem.columns(theta)
    zeros = [campaign.conditions.setup == s for s in campaign.setups]
    nuisances = np.array(zeros, dtype=float).T
    x = np.hstack([columns / problem.weight[:, None], nuisances])
    if more is not None:
        x = np.hstack([x, more])
    x = x[:, np.linalg.norm(x, axis=0) > 0.0]
    size = np.linalg.norm(x, axis=0)
    lower = np.linalg.cholesky(covariance(campaign))
    white, y = np.linalg.solve(lower, x / size), np.linalg.solve(lower, campaign.value)
    beta, _, rank, _ = np.linalg.lstsq(white, y, rcond=1e-9)
    left = y - white @ beta
    error = campaign.value - (x / size) @ beta
    # what of it the gauges' own errors are: their conditional mean
    common = (covariance(campaign) - np.diag(campaign.sd**2)) @ np.linalg.solve(
        covariance(campaign), error
    )
    shape = (x / size) @ np.linalg.pinv(white.T @ white, rcond=1e-12) @ (x / size).T
    return float(left @ left), rank, error - common, shape


def test_solution_chi2_and_uncertainty_are_those_of_the_whole_covariance_matrix() -> None:
    wanted, campaign = gauged()
    result = fit(wanted, campaign)
    chi2, rank, residual, _ = dense(result, campaign)
    assert result.chi2 == pytest.approx(chi2, rel=1e-9)
    assert result.dof == campaign.n - rank
    assert result.residual == pytest.approx(residual, abs=1e-9 * np.abs(campaign.value).max())
    plain = fit(wanted, replace(campaign, gauge=None, gauge_sd=None))
    assert abs(plain.chi2 - result.chi2) > 0.1 * chi2, "the gauges do not matter here"


def test_predictions_are_as_uncertain_as_the_whole_covariance_matrix_says() -> None:
    """Of what a set-up sees against its first row: zeros, and what nothing determines, apart."""
    wanted, campaign = gauged()
    result = fit(wanted, campaign)
    columns = result.problem.columns(result.theta) / result.problem.weight[:, None]
    found = columns @ result.decomposition.covariance() @ columns.T
    *_, expected = dense(result, campaign)
    setup = campaign.conditions.setup
    assert setup is not None
    first = np.array([np.argmax(setup == name) for name in setup])
    apart = np.eye(campaign.n) - np.eye(campaign.n)[first]
    size = np.abs(apart @ expected @ apart.T).max()
    np.testing.assert_allclose(
        apart @ found @ apart.T, apart @ expected @ apart.T, atol=1e-7 * size
    )


@pytest.mark.parametrize("most", [7, 20, 90])
def test_row_blocks_give_what_the_whole_gives(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    wanted, campaign = gauged()
    whole = fit(wanted, campaign)
    absorbed = leverage(whole.problem, whole.theta, whole.decomposition)
    monkeypatch.setattr(row_blocks, "BLOCK_BYTES", most * 8 * (whole.problem.layout.size + 1))
    monkeypatch.setattr(row_blocks, "FEWEST_ROWS", 1)
    in_blocks = fit(wanted, campaign)
    assert in_blocks.problem.large
    assert in_blocks.theta == pytest.approx(whole.theta, abs=1e-12)
    assert in_blocks.residual == pytest.approx(whole.residual, abs=1e-12)
    assert in_blocks.chi2 == pytest.approx(whole.chi2, rel=1e-9)
    found = leverage(in_blocks.problem, in_blocks.theta, in_blocks.decomposition)
    assert found == pytest.approx(absorbed, abs=1e-9)


def test_a_candidate_lowers_chi2_by_what_a_whole_refit_would() -> None:
    wanted, campaign = gauged(seed=4)
    result = fit(wanted, campaign)
    columns = np.random.default_rng(1).normal(size=(campaign.n, 2))
    (found,) = screen(Basis.of(result), [(0, {}, lambda: columns)])
    before, *_ = dense(result, campaign)
    after, *_ = dense(result, campaign, columns / result.problem.weight[:, None])
    assert before - after > 0.5
    assert found.drop == pytest.approx(before - after, rel=1e-6)


def test_a_gauge_in_two_files_is_one_gauge() -> None:
    _, campaign = gauged()
    other = replace(campaign, name="other.csv", gauge=None, gauge_sd=None)
    joined = join_campaigns([campaign, campaign, other])
    n = campaign.n
    assert joined.gauge is not None
    assert joined.gauge_sd is not None
    assert joined.gauge.tolist() == [*campaign.gauge, *campaign.gauge, *[""] * n]
    assert joined.gauge_sd[2 * n :].tolist() == [0.0] * n


def test_the_file_keeps_gauges(tmp_path: Path) -> None:
    lines = GOOD.splitlines()
    lines[15] += ",gauge,gauge_sd"
    lines[16:] = [f"{row},," for row in lines[16:]]
    lines[17] = f"{lines[17][:-2]},block 7,0.08"
    lines[18] = f"{lines[18][:-2]},level,0.3"
    campaign = read_text(tmp_path, "\n".join(lines) + "\n")
    assert campaign.gauge is not None
    assert campaign.gauge.tolist() == ["", "block 7", "level", "", ""]
    np.testing.assert_allclose(campaign.gauge_sd, [0.0, 8e-5, 3e-7, 0.0, 0.0], rtol=1e-12)
    write_campaign(campaign, tmp_path / "again.csv")
    again = read_campaign(tmp_path / "again.csv", CMM)
    assert again.gauge is not None
    assert again.gauge.tolist() == campaign.gauge.tolist()
    np.testing.assert_array_equal(again.gauge_sd, campaign.gauge_sd)
    for place, text, words in (
        (17, "block 7,", "'gauge_sd': a blank cell"),
        (17, ",0.08", "'gauge': an uncertainty of no gauge"),
        (17, "block 7,0", "'gauge_sd': not a standard uncertainty"),
        (17, "block 7,-1", "'gauge_sd': not a standard uncertainty"),
        (17, "block 7,1e9", "'gauge_sd': not believable"),
    ):
        bad = [*lines]
        bad[place] = re.sub("block 7,0.08$", text, bad[place])
        with pytest.raises(InputError, match=f"line {place + 1}, field {words}"):
            read_text(tmp_path, "\n".join(bad) + "\n")
    bad = [re.sub(",[^,]*$", "", line) if i > 14 else line for i, line in enumerate(lines)]
    with pytest.raises(InputError, match="a gauge has its name and its uncertainty"):
        read_text(tmp_path, "\n".join(bad) + "\n")


SCALE = """format = "abbe-model/1"
[machine]
name = "small"
structure = "w b Y X Z t"
[machine.axes.X]
travel = [0.0, 600.0]
[machine.axes.Y]
travel = [0.0, 500.0]
[machine.axes.Z]
travel = [-300.0, 0.0]
[[effects]]
kind = "scale"
axis = "X"
"""


def block(folder: Path, runs: int, sd: float) -> Path:
    """A block of 500.0002 mm along X; a machine that reads 5 µm short, 0.2 µm a probing."""
    rng = np.random.default_rng(3)
    head = "position,run,calibrated" + (",sd" if sd else "") + ",x1,y1,z1,x2,y2,z2"
    rows = [
        f"X,{run + 1},500.0002{f',{sd}' if sd else ''},{50 + rng.normal() * 2e-4:.6f},100,-50,"
        f"{549.9952 + rng.normal() * 2e-4:.6f},100,-50"
        for run in range(runs)
    ]
    path = folder / f"block{runs}-{sd}.csv"
    path.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("runs", [3, 50])
def test_many_readings_of_one_block_do_not_know_the_scale_better_than_it_is_known(tmp_path, runs):
    """sd² of the scale = (calibration² + 2·probing²/runs) / L², by hand; also the weight."""
    (tmp_path / "m.toml").write_text(SCALE, encoding="utf-8")
    probing, known = 0.2, 0.4
    found = {}
    for sd in (0.0, known):
        out, model = tmp_path / f"c{sd}.csv", tmp_path / f"f{sd}.toml"
        done = abbe("import-campaign", block(tmp_path, runs, sd), "--as", "lengths", "--model",
                    tmp_path / "m.toml", "--sd", probing, "-o", out)  # fmt: skip
        assert done.status == 0, done.err
        done = abbe("fit", tmp_path / "m.toml", out, "-o", model, "--json")
        assert done.status == 0, done.err
        answer = json.loads(done.out)
        (value,) = load_model(model).terms[0].values.values()
        assert value.sd is not None
        inflation = max(1.0, answer["chi2_per_dof"]) ** 0.5
        expected = np.sqrt(sd**2 * 1e-6 + 2.0 * (probing * 1e-3) ** 2 / runs) / 500.0
        assert value.sd / inflation == pytest.approx(expected, rel=1e-3)
        assert runs < 10 or answer["chi2_per_dof"] == pytest.approx(1.0, abs=0.5)
        found[sd] = (value.value, answer["chi2_per_dof"])
        assert list(answer["gauges"]) == (["500.000200 mm"] if sd else [])
    # alone the block's error cannot be told from the scale, nor does it show as misfit
    assert found[known] == pytest.approx(found[0.0], rel=1e-4)


def test_a_laser_that_knows_better_says_what_the_block_is(tmp_path):
    """The block is 1.2 µm longer than its certificate with 0.4 says: told, and not the scale's."""
    (tmp_path / "m.toml").write_text(SCALE, encoding="utf-8")
    lengths, campaign, laser = (tmp_path / n for n in ("b.csv", "c.csv", "laser.csv"))
    rows = [f"X,{r},500.0002,0.4,50,100,-50,{549.9952 + 1.2e-3},100,-50" for r in range(1, 21)]
    lengths.write_text(
        "\n".join(["position,run,calibrated,sd,x1,y1,z1,x2,y2,z2", *rows]) + "\n", encoding="utf-8"
    )
    done = abbe("import-campaign", lengths, "--as", "lengths", "--model", tmp_path / "m.toml",
                "--sd", "0.2", "-o", campaign)  # fmt: skip
    assert done.status == 0, done.err
    head = ['# format = "abbe-campaign/1"', "time,setup,kind,X,Y,Z,ux,uy,uz,value,sd"]
    line = [f"{i},l,displacement,{x},100,-50,1,0,0,{1e-2 * x:.4f},0.05"
            for i, x in enumerate(range(0, 601, 25))]  # fmt: skip
    laser.write_text("\n".join([*head, *line]) + "\n", encoding="utf-8")
    done = abbe("fit", tmp_path / "m.toml", campaign, laser, "-o", tmp_path / "f.toml")
    assert done.status == 0, done.err
    (value,) = load_model(tmp_path / "f.toml").terms[0].values.values()
    # actual − indicated is 10 µm/m by the laser; the block says 7.6 and is told to be wrong
    assert value.value == pytest.approx(1e-5, abs=3 * value.sd)
    assert value.value == pytest.approx(1e-5, abs=1e-7)
    (said,) = re.findall(r"gauge 500\.000200 mm: .*", done.out)
    assert "off by 3.0 times its standard uncertainty" in said or "by 2.9 times" in said, said
    alone = abbe("fit", tmp_path / "m.toml", laser, "-o", tmp_path / "g.toml")
    assert "gauge" not in alone.out


def test_a_block_that_is_not_what_its_certificate_says_is_no_fault_of_the_machine(tmp_path):
    """2 standard uncertainties, in twelve placings, beside four lines of a laser: nothing more."""
    rng = np.random.default_rng(2)
    (tmp_path / "m.toml").write_text(SCALE, encoding="utf-8")
    actual = 500.0002 + 1e-3
    rows = ["position,run,calibrated,sd,x1,y1,z1,x2,y2,z2"]
    for i in range(12):
        one, two = (float(rng.normal(0.0, 2e-4)) for _ in range(2))
        rows.append(f"p{i},1,500.0002,0.5,{50 + one:.6f},{40 * i},-50,"
                    f"{50 + actual / (1 + 1e-5) + two:.6f},{40 * i},-50")  # fmt: skip
    (tmp_path / "b.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    lines = ['# format = "abbe-campaign/1"', "time,setup,kind,X,Y,Z,ux,uy,uz,value,sd"]
    lines += [
        f"{i + 100 * k},l{k},displacement,{x},{100 * k},-50,1,0,0,{1e-2 * x + 0.1 * e:.4f},0.1"
        for k in range(4)
        for i, (x, e) in enumerate(zip(range(0, 601, 25), rng.normal(size=25), strict=True))
    ]
    (tmp_path / "l.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    lengths, laser, fitted = (tmp_path / n for n in ("c.csv", "l.csv", "f.toml"))
    done = abbe("import-campaign", tmp_path / "b.csv", "--as", "lengths", "--model",
                tmp_path / "m.toml", "--sd", "0.2", "-o", lengths)  # fmt: skip
    assert done.status == 0, done.err
    assert abbe("fit", tmp_path / "m.toml", lengths, laser, "-o", fitted).status == 0
    (value,) = load_model(fitted).terms[0].values.values()
    assert value.value == pytest.approx(1e-5, abs=2.0 * value.sd)
    said = abbe("diagnose", fitted, lengths, laser, "--no-measure-next", "--json")
    assert json.loads(said.out)["verdict"] == "complete"
    # not knowing of the block's uncertainty the machine is blamed
    campaign = lengths.read_text("utf-8")
    bare = re.sub(r",(gauge,gauge_sd|500\.000200 mm,[0-9.]+|,)$", "", campaign, flags=re.M)
    lengths.write_text(bare, encoding="utf-8")
    assert "gauge" not in lengths.read_text("utf-8").partition("time,")[2]
    assert abbe("fit", tmp_path / "m.toml", lengths, laser, "-o", fitted).status == 0
    said = abbe("diagnose", fitted, lengths, laser, "--no-measure-next", "--json")
    assert json.loads(said.out)["verdict"] != "complete"
