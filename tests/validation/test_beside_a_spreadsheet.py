"""No worse than a spreadsheet: every real set that is shipped, on rows that were not fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from benchmarks.alternatives.spreadsheet import left_out, regressed, rms
from benchmarks.real_sets import REAL, Beside, beside, campaigns, section


@pytest.mark.parametrize("name", campaigns())
def test_real_measurements_are_foretold_no_worse_than_by_a_regression(name: str) -> None:
    found = beside(name)
    assert found.abbe <= found.spreadsheet < found.nothing


def test_every_set_that_is_shipped_is_asked() -> None:
    assert {name.partition("/")[0] for name in campaigns()} == {
        folder.name for folder in REAL.iterdir() if folder.is_dir()
    }


def test_a_load_cells_straight_line_leaves_what_a_spreadsheet_leaves() -> None:
    """By numpy's own line, and 52.6 µm as everyone finds who fits one to NIST's Pontius."""
    model = load_model(REAL / "r05-load-cell" / "model.toml")
    run, check = (
        read_campaign(REAL / "r05-load-cell" / f"{f}.csv", model.machine) for f in ("run", "check")
    )
    slope, _ = np.polyfit(run.conditions.signal("load"), run.value, 1)
    line = check.value - slope * check.conditions.signal("load")
    left = regressed(run, check)
    assert left == pytest.approx(line - line.mean(), abs=1e-9)
    assert 1e3 * rms(left) == pytest.approx(52.6, abs=0.05)


def test_a_world_of_sines_is_regressed_to_its_noise_block_by_block() -> None:
    """Both components of each star apart, each with its own sines of both axes."""
    model = load_model(REAL / "r01-telescope" / "model.toml")
    run = read_campaign(REAL / "r01-telescope" / "run.csv", model.machine)
    rng = np.random.default_rng(4)
    c, b = run.conditions.position("C"), run.conditions.position("B")
    first = np.arange(run.n) % 2 == 0
    made = np.where(first, 3e-5 * np.sin(c) - 1e-5 * np.cos(b), 2e-5 * np.sin(b) + 4e-5)
    noise = rng.normal(scale=1e-6, size=run.n)
    blocks = np.array_split(np.arange(run.n), 8)
    left = left_out(replace(run, value=made + noise), blocks)
    assert 1.0 < rms(left) / rms(noise) < 1.3
    assert rms(left_out(replace(run, value=made), blocks)) < 1e-12


def test_the_table_has_a_line_for_each() -> None:
    one = Beside("r/run.csv", 9, "another run or day", "µm", 30.0, 5.25, 3.0, ("scale axis=X",))
    assert section([one, one]).splitlines()[-1] == (
        "| r/run.csv | 9 | another run or day | 30 | 5.25 | 3 µm | 1 |"
    )
