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


def by_direction(file: Path, column: str) -> np.ndarray:
    """A table's values after positive arrival less those after negative arrival, by position."""
    lines = file.read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    name, unit = column.split()
    up, down = ([float(r[f"{name} ({way}) {unit}"]) for r in rows] for way in "+-")
    at = [float(r[next(iter(r))]) for r in rows]
    return np.array([at, np.array(up) - np.array(down)])


def named_and_added(start: str, rows: list[str], columns: str, made: Path) -> tuple[dict, Path]:
    """The first candidate of a diagnosis of the rows, and the tables once it was added."""
    head = ['# format = "abbe-campaign/1"', "# [setups.a]", "# free = []", columns]
    (made / "c.csv").write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    (made / "m.toml").write_text(start, encoding="utf-8")
    fitted, campaign, following = (made / n for n in ("f.toml", "c.csv", "g.toml"))
    run("fit", made / "m.toml", campaign, "-o", fitted)
    answer = json.loads(run("diagnose", fitted, campaign, "--no-measure-next", "--json"))
    assert answer["verdict"] == "missing"
    best = answer["candidates"][0]
    run("add", fitted, *best["spec"].split(), "--campaign", campaign, "-o", following)
    run("table", following, "--controller", "csv", "-o", made / "t")
    return best, made / "t"


def test_a_squareness_that_depends_on_the_direction(tmp_path):
    """A square of granite along X, up and down: 6 µrad between the two ways, over 500 mm 3 µm."""
    rng = np.random.default_rng(12)
    rows = []
    for turn in range(6):
        way = 1 if turn % 2 == 0 else -1
        for i, x in enumerate(np.linspace(0.0, 500.0, 21)[::way]):
            value = 2e-2 * x + 0.5 * way * 6e-3 * x + 0.2 * rng.normal()
            rows.append(f"{1200 * turn + 60 * i},a,displacement,{x:g},100,-50,{way},0,1,0,"
                        f"{value:.4f},0.2")  # fmt: skip
    start = MODEL + '[[effects]]\nkind = "squareness"\naxes = ["Y", "X"]\n'
    columns = "time,setup,kind,X,Y,Z,X_dir,ux,uy,uz,value,sd"
    best, tables = named_and_added(start, rows, columns, tmp_path)
    assert best["spec"] == "lateral_reversal axis=X direction=Y shape=polynomial:1"
    at, step = by_direction(tables / "x.csv", "E_YX [mm]")
    np.testing.assert_allclose(step, 6e-6 * at, atol=2.5e-4)
    # 126 readings of 0.2 µm know the slope between the ways to 0.12 µrad
    slope = np.polynomial.Polynomial.fit(at, step, 1).convert().coef[1]
    assert slope == pytest.approx(6e-6, abs=0.5e-6)


ROTARY = MODEL[: MODEL.index("[[effects]]")].replace("w b Y X Z t", "w C' b X Y Z t") + (
    "[machine.axes.C]\ntravel = [-360.0, 360.0]\nlocation = [250.0, 200.0, 0.0]\n"
    '[[effects]]\nkind = "rotary_location"\naxis = "C"\n'
)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("spec", "shift", "turn", "column", "step"),
    [
        ("lateral_reversal axis=C direction=X", (3.0, 0, 0), (0, 0, 0), "E_XC [mm]", 3e-3),
        ("lateral_reversal axis=C direction=Z", (0, 0, -3.0), (0, 0, 0), "E_ZC [mm]", -3e-3),
        ("backlash axis=C", (0, 0, 0), (0, 0, 20e-6), "E_CC [rad]", 20e-6),
        ("reversal_angle axis=C about=X", (0, 0, 0), (-20e-6, 0, 0), "E_AC [rad]", -20e-6),
    ],
)
def test_rotary_axes(tmp_path, spec, shift, turn, column, step):
    """A sphere on a turning table, followed both ways round: e = s/2 · (shift + turn × place)."""
    rng = np.random.default_rng(5)
    rows = []
    for round_ in range(4):
        way, height = (1, -1)[round_ % 2], (-200.0, -160.0)[round_ // 2]
        for i, c in enumerate(np.arange(0, 360, 30)[::way]):
            place = np.array([150 * np.cos(np.deg2rad(c)), 150 * np.sin(np.deg2rad(c)), height])
            error = np.array([2.0, -1.0, 0.0])  # where the line of C lies, µm
            error += 0.5 * way * (np.array(shift) + 1e3 * np.cross(turn, place))
            for k in range(3):
                u = ",".join("1" if k == j else "0" for j in range(3))
                rows.append(
                    f"{600 * round_ + 20 * i + k},a,displacement,"
                    f"{place[0] + 250:.6f},{place[1] + 200:.6f},{height},{c},{way},{u},"
                    f"{error[k] + 0.2 * rng.normal():.4f},0.2"
                )
    columns = "time,setup,kind,X,Y,Z,C,C_dir,ux,uy,uz,value,sd"
    best, tables = named_and_added(ROTARY, rows, columns, tmp_path)
    assert best["spec"] == spec
    _, held = by_direction(tables / "c.csv", column)
    # 24 readings a way: 0.06 µm, 0.4 µrad
    np.testing.assert_allclose(held, step, atol=0.3e-3 if "mm" in column else 2e-6)


DATA = Path(__file__).parents[3] / "data" / "p02-bridge"


@pytest.mark.thorough
@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("axis", "direction", "per_mm", "spec"),
    [
        ("X", "Y", 0.0, "lateral_reversal axis=X direction=Y"),
        ("Y", "Z", 6e-3, "lateral_reversal axis=Y direction=Z shape=polynomial:1"),
    ],
)
def test_hidden_in_a_whole_campaign_of_a_bridge(tmp_path, axis, direction, per_mm, spec):
    """2 µm, or 6 µrad, put into the campaign of a machine that lacks nothing otherwise."""
    lines = (DATA / "fit.csv").read_text("utf-8").splitlines()
    top = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    names = lines[top].split(",")
    for i in range(top + 1, len(lines)):
        row = dict(zip(names, lines[i].split(","), strict=True))
        if row["kind"] == "displacement":
            step = (per_mm * float(row[axis]) if per_mm else STEP) * float(row[f"{axis}_dir"])
            seen = float(row[f"u{direction.lower()}"])
            row["value"] = f"{float(row['value']) + 0.5 * step * seen:.6f}"
            lines[i] = ",".join(row.values())
    campaign, fitted = tmp_path / "c.csv", tmp_path / "f.toml"
    campaign.write_text("\n".join(lines) + "\n", encoding="utf-8")
    run("fit", DATA / "model.toml", campaign, "-o", fitted)
    answer = json.loads(run("diagnose", fitted, campaign, "--no-measure-next", "--json"))
    assert answer["verdict"] == "missing"
    assert answer["candidates"][0]["spec"] == spec
    assert len(answer["candidates"]) == 1


def test_along_the_axis_it_is_backlash(folder, tmp_path):
    done = abbe("add", folder / "fitted.toml", "lateral_reversal", "axis=X", "direction=X",
                "--campaign", folder / "c.csv", "-o", tmp_path / "x.toml")  # fmt: skip
    assert done.status == 1
    assert "the effect is 'backlash'" in done.err
