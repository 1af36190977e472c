"""A carriage that steps aside when it reverses: found, named, fitted, and held by tables."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from tests.support.daemon.command_line import abbe

MODEL = """format = "abbe-model/1"
[machine]
name = "small"
structure = "w b Y X Z t"
[machine.axes.X]
travel = [0.0, 500.0]
[machine.axes.Y]
travel = [0.0, 400.0]
[machine.axes.Z]
travel = [-300.0, 0.0]
[[effects]]
kind = "straightness"
axis = "X"
direction = "Y"
shape = "polynomial:3"
"""
STEP = 2.0
"""µm between the two ways."""


def run(*words: object) -> str:
    done = abbe(*words)
    assert done.status == 0, done.err
    return done.out


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A straightedge along X, three times there and back, at two heights; noise of 0.2 µm."""
    made = tmp_path_factory.mktemp("lateral")
    rng = np.random.default_rng(11)
    rows, i = [], 0
    for turn in range(6):
        up = turn % 2 == 0
        z = (-50.0, -250.0)[turn // 3]
        for x in np.linspace(0.0, 500.0, 21)[:: 1 if up else -1]:
            bow = 6e-5 * x * (500.0 - x) / 3.0  # up to 1.25 µm
            value = bow + (0.5 if up else -0.5) * STEP + 0.2 * rng.normal()
            rows.append(f"{60 * i},s{turn // 3},displacement,{x:g},100,{z:g},{1 if up else -1},"
                        f"0,1,0,{value:.4f},0.2")  # fmt: skip
            i += 1
    head = ['# format = "abbe-campaign/1"', "# [setups.s0]", '# free = ["zero", "slope"]',
            "# [setups.s1]", '# free = ["zero", "slope"]',
            "time,setup,kind,X,Y,Z,X_dir,ux,uy,uz,value,sd"]  # fmt: skip
    (made / "c.csv").write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    (made / "m.toml").write_text(MODEL, encoding="utf-8")
    run("fit", made / "m.toml", made / "c.csv", "-o", made / "fitted.toml")
    return made


def test_a_hidden_one_is_named_and_tables_hold_it_by_direction(folder, tmp_path):
    campaign, model = folder / "c.csv", tmp_path / "next.toml"
    answer = json.loads(run("diagnose", folder / "fitted.toml", campaign, "--json"))
    assert answer["verdict"] == "missing"
    best = answer["candidates"][0]
    group = [best["spec"], *(str(c) for c in best["confusable_with"])]
    assert best["spec"] == "lateral_reversal axis=X direction=Y", group
    value = best["parameters"]["b"]
    # the sign is that of the positive direction; ten standard deviations are 0.4 µm
    assert value["value"] * {"mm": 1e3, "um": 1.0, "µm": 1.0}[value["unit"]] == pytest.approx(
        STEP, abs=0.2
    )
    words = best["spec"].split()
    run("add", folder / "fitted.toml", *words, "--campaign", campaign, "-o", model)
    run("table", model, "--controller", "csv", "-o", tmp_path / "t")
    lines = (tmp_path / "t" / "x.csv").read_text(encoding="utf-8").splitlines()
    table = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    up, down = ([float(r[f"E_YX ({way}) [mm]"]) for r in table] for way in "+-")
    np.testing.assert_allclose(np.array(up) - np.array(down), STEP * 1e-3, atol=2e-4)


def test_along_the_axis_it_is_backlash(folder, tmp_path):
    done = abbe("add", folder / "fitted.toml", "lateral_reversal", "axis=X", "direction=X",
                "--campaign", folder / "c.csv", "-o", tmp_path / "x.toml")  # fmt: skip
    assert done.status == 1
    assert "the effect is 'backlash'" in done.err
