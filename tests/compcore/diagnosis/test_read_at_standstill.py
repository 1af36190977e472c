"""Places read three times in one visit: other places judge, and no place counts thrice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.left_out.crossvalidation import folds
from abbe.compcore.diagnosis.screening.left_out.independence import independent_share
from abbe.compcore.diagnosis.stepwise.to_the_verdict import to_the_verdict
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.machine.conditions import Conditions

F64 = NDArray[np.float64]

READ = 3
HOLES = 60
SCATTER = 5.0
"""Of the holes about where the machine drills them, µm."""


def conditions(positions: dict[str, F64], times: int) -> Conditions:
    """Rows of one set-up without a clock, every place read so many times."""
    again = {axis: np.repeat(at, times) for axis, at in positions.items()}
    n = len(next(iter(again.values())))
    still = {axis: np.zeros(n) for axis in again}
    setup = np.full(n, "one")
    up = np.tile([0.0, 0.0, 1.0], (n, 1))
    return Conditions(again, still, np.zeros((n, 3)), np.zeros(n), setup=setup, u=up)


def split(positions: dict[str, F64], times: int) -> int:
    """How many places have readings in more than one fold."""
    parts = folds(conditions(positions, times))
    fold = np.empty(sum(map(len, parts)), dtype=int)
    for k, rows in enumerate(parts):
        fold[rows] = k
    return sum(len(set(own)) > 1 for own in fold.reshape(-1, times))


def scattered(n: int, axes: str) -> dict[str, F64]:
    rng = np.random.default_rng(2)
    return {axis: rng.uniform(0.0, 400.0, n) for axis in axes}


def test_poses_are_left_out_whole_and_targets_visit_by_visit() -> None:
    assert split(scattered(HOLES, "XYZ"), READ) == 0
    grid = np.array([(x, y) for x in range(0, 401, 50) for y in range(0, 401, 50)], dtype=float)
    assert split({"X": grid[:, 0], "Y": grid[:, 1]}, READ) == 0
    line = np.linspace(0.0, 400.0, 9)
    assert split({"X": line}, 5) == len(line)
    # a diagonal, and a line of each axis one after the other
    assert split({"X": line, "Y": line}, 5) == len(line)
    corner = {"X": np.append(line, np.zeros(8)), "Y": np.append(np.zeros(9), line[1:])}
    assert split(corner, 5) == 17


def test_what_a_model_lacks_counts_once_a_place() -> None:
    rng = np.random.default_rng(1)
    lacks, noise = rng.normal(0.0, 1.0, (600, 1)), rng.normal(0.0, 1.0, (600, READ))
    rows = conditions(scattered(600, "XYZ"), READ)
    # n of a place whose residuals share ρ = s²/(s² + 1) say as much as n/(1 + 2ρ)
    for size in (0.0, 1.0, 100.0):
        share = independent_share((size * lacks + noise).ravel(), rows)
        rho = size**2 / (size**2 + 1.0)
        assert share == pytest.approx(1.0 / (1.0 + (READ - 1) * rho), rel=0.1)
    line = conditions({"X": np.linspace(0.0, 400.0, 12)}, 5)
    assert independent_share(np.repeat(rng.normal(0.0, 1.0, 12), 5), line) == 1.0


def test_holes_that_scatter_are_no_shape_of_a_guideway(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    at = rng.uniform(20.0, 380.0, (HOLES, 2))
    drilled = np.column_stack([60e-3 * at[:, 1], np.zeros(HOLES)])
    drilled += rng.normal(0.0, SCATTER, drilled.shape)
    text = ['format = "abbe-model/1"', "[machine]", 'structure = "w b X Y Z t"']
    text += [f"[machine.axes.{a}]\ntravel = [0.0, 400.0]" for a in "XYZ"]
    rows = ['# format = "abbe-campaign/1"', "# [setups.plate]", '# free = ["frame"]']
    rows.append("setup,kind,X,Y,Z,ux,uy,uz,value,sd")
    for (x, y), error in zip(at, drilled, strict=True):
        for _ in range(READ):
            for u, value in zip(("1,0,0", "0,1,0"), error + rng.normal(0.0, 0.3, 2), strict=True):
                rows.append(f"plate,displacement,{x:.3f},{y:.3f},0,{u},{value:.3f},1")
    (tmp_path / "mill.toml").write_text("\n".join(text) + "\n", "utf-8")
    (tmp_path / "plate.csv").write_text("\n".join(rows) + "\n", "utf-8")
    model = load_model(tmp_path / "mill.toml")
    campaign = read_campaign(tmp_path / "plate.csv", model.machine)
    course = to_the_verdict(model, campaign)
    assert [e.spec for e in course.steps[-1].result.model.effects] == ["squareness axes=X,Y"]
