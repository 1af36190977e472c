"""Squareness 'by adjusting straightness': the map article's second form, by the command line.

Truth is the article's rule, written out in `tests.support.compcore.article_map`: one column of the
published map is changed by hand, and the rule applied step by step.
"""

from __future__ import annotations

import json
import re
import shlex

import numpy as np
import pytest

from abbe.compcore.files.map_file import load_map
from abbe.compcore.files.model_file import load_model
from tests.daemon.commands.maps.test_map_commands import BRIDGE, MAP
from tests.support.compcore.article_map import correction
from tests.support.daemon.command_line import abbe

SLOPE = -50e-6
"""X turned against Y by −50 µrad, right-handed about Z: 50 µm a metre of X towards −Y."""
POINT = {"X": 275.0, "Y": 512.3, "Z": -87.1}
TOOL = np.array([12.0, -30.0, -80.0])
LY, RZ = 1, 5


def article():
    """The published map: axis → (positions, values in mm and rad)."""
    tables = load_map(MAP).tables
    return {a: (np.array(t.positions), t.array()) for a, t in tables.items()}


def with_gradient():
    """'By adjusting straightness': a slope in X's Ly, every other column as published."""
    tables = article()
    at, values = tables["X"]
    values[:, LY] += SLOPE * at
    return tables


def with_constant():
    """'By adjusting the angle': a constant in all of Y's Rz, every other column as published."""
    tables = article()
    tables["Y"][1][:, RZ] += SLOPE
    return tables


@pytest.mark.parametrize(
    ("form", "truth", "published"),
    [
        (("--squareness-as", "gradient"), with_gradient, (31.167, 157.290, 67.658)),
        (("--squareness-as", "angle"), with_constant, (29.667, 156.691, 67.658)),
        ((), with_constant, (29.667, 156.691, 67.658)),
    ],
)
def test_a_stated_squareness_leaves_the_map_s_columns_alone(tmp_path, form, truth, published):
    out = tmp_path / "m.toml"
    made = abbe("import-map", MAP, *BRIDGE, "--squareness", "YX=-50urad", *form, "-o", out)
    assert made.status == 0, made.err
    assert "--squareness YX=-50urad" in load_model(out).fit["convention"]
    typed = [f"{a}={v}" for a, v in POINT.items()]
    done = abbe("correct", out, *typed, "tool=12,-30,-80", "--json")
    got = [json.loads(done.out)["correction"][a] * 1e3 for a in "XYZ"]
    expected = correction(truth(), "YXZ", POINT, TOOL) * 1e3
    np.testing.assert_allclose(got, expected, atol=1e-6)
    np.testing.assert_allclose(got, published, atol=5e-4)


def points_of(tables, path):
    """Forty points of a controller that applies these tables by the article's rule, to 0.1 µm."""
    rng = np.random.default_rng(8)
    rows = []
    for _ in range(40):
        q = {"X": rng.uniform(0, 400), "Y": rng.uniform(0, 800), "Z": rng.uniform(-200, 0)}
        q = {a: round(v, 2) for a, v in q.items()}
        tool = np.round(rng.uniform(-100, 100, 3), 1)
        found = correction(tables, "YXZ", q, tool) * 1e3
        rows.append([*q.values(), *tool, *np.round(found, 1)])
    head = '# format = "abbe-points/1"\n# unit = "um"\n'
    body = "\n".join(",".join(f"{v:.10g}" for v in row) for row in rows)
    path.write_text(f"{head}X,Y,Z,tool_x,tool_y,tool_z,dX,dY,dZ\n{body}\n", encoding="utf-8")
    return np.array(rows)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("truth", "verdict", "printed"),
    [
        (with_gradient, "Identified: the stated squareness as gradient.", "-as gradient"),
        (with_constant, "Identified: Abbe's own conventions.", "--squareness YX=-50urad"),
    ],
)
def test_which_form_a_controller_uses_is_found_and_the_printed_command_is_the_same_map(
    tmp_path, monkeypatch, truth, verdict, printed
):
    rows = points_of(truth(), tmp_path / "points.csv")
    stated = ("--squareness", "YX=-50urad")
    monkeypatch.chdir(tmp_path)
    spaced = tmp_path / "my map.txt"
    spaced.write_bytes(MAP.read_bytes())
    done = abbe("identify-convention", spaced, "points.csv", *BRIDGE, *stated)
    assert done.status == 0, done.err
    assert verdict in done.out
    command = re.search(r"^  (abbe import-map .*)$", done.out, re.M)[1]
    assert printed in command
    data = abbe("identify-convention", spaced, "points.csv", *BRIDGE, *stated, "--json")
    found = json.loads(data.out)
    assert found["import_command"] == command
    assert found["best"]["rms"] < 0.05
    words = shlex.split(command)
    assert words[0] == "abbe"
    run = abbe(*words[1:])
    assert run.status == 0, run.err
    again = abbe("identify-convention", spaced, "points.csv", *BRIDGE, *stated)
    assert "-o model-2.toml" in again.out, "what was written would be overwritten"
    for row in rows[:5]:
        typed = [f"{a}={v}" for a, v in zip("XYZ", row[:3], strict=True)]
        tool = "tool=" + ",".join(map(str, row[3:6]))
        shown = json.loads(abbe("correct", "model.toml", *typed, tool, "--json").out)
        got = [shown["correction"][a] * 1e3 for a in "XYZ"]
        np.testing.assert_allclose(got, row[6:], atol=0.0501)


def test_a_squareness_that_is_not_stated_is_not_made_up(tmp_path):
    """Without --squareness the same points are reproduced by no convention of the map alone."""
    points_of(with_gradient(), tmp_path / "points.csv")
    done = abbe("identify-convention", MAP, tmp_path / "points.csv", *BRIDGE)
    assert "None reproduces the points." in done.out
    assert "abbe import-map" not in done.out
