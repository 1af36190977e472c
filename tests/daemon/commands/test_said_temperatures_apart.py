"""Thermometers that stand to each other as never before: compare, diagnose and correct say so."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from tests.support.daemon.command_line import abbe

MODEL = """format = "abbe-model/1"
[machine]
name = "lathe"
structure = "w b Z X t"
[machine.axes.X]
travel = [0.0, 200.0]
[machine.axes.Z]
travel = [0.0, 400.0]
[machine.signals.T_front]
unit = "degC"
role = "spindle"
[machine.signals.T_rear]
unit = "degC"
role = "spindle"
[[effects]]
kind = "thermal_offset"
direction = "X"
signal = "T_front"
[[effects]]
kind = "thermal_offset"
direction = "X"
signal = "T_rear"
"""
ROWS = 60
FRONT = np.linspace(20.0, 30.0, ROWS)
APART = np.sin(np.arange(ROWS))
"""K that the rear bearing is warmer than the front one, on the days of the fit."""
OF_IT = 0.25
"""Part of the rows of the other day on which the front bearing is cooled."""


def written(path: Path, front: np.ndarray, rear: np.ndarray, more: np.ndarray) -> Path:
    """A campaign of a machine that moves by both bearings, and `more`, µm."""
    noise = np.random.default_rng(1).normal(scale=0.3, size=ROWS)
    error = 5.0 * (front - 20.0) - 4.0 * (rear - 20.0) + more + noise
    rows = [
        f"{60 * i},a,displacement,100,200,1,0,0,{e:.3f},0.3,{f:.3f},{r:.3f}"
        for i, (e, f, r) in enumerate(zip(error, front, rear, strict=True))
    ]
    head = [
        '# format = "abbe-campaign/1"', '# instrument = "probe"', "# [setups.a]",
        '# free = ["zero"]', "time,setup,kind,X,Z,ux,uy,uz,value,sd,T_front,T_rear",
    ]  # fmt: skip
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> tuple[Path, Path, Path]:
    """The fitted model, its campaign, and another day on which the front bearing is cooled."""
    folder = tmp_path_factory.mktemp("apart")
    start, fitted = folder / "m.toml", folder / "fitted.toml"
    start.write_text(MODEL, encoding="utf-8")
    days = written(folder / "days.csv", FRONT, FRONT + APART, np.zeros(ROWS))
    done = abbe("fit", start, days, "-o", fitted)
    assert done.status == 0, done.err
    cooled = np.arange(ROWS) >= (1.0 - OF_IT) * ROWS
    # each stays within what it read, and the machine no longer does what it did
    front = np.where(cooled, FRONT - 6.0, FRONT)
    rear = np.where(cooled, FRONT, FRONT + APART)
    other = written(folder / "other.csv", front, rear, np.where(cooled, 12.0, 0.0))
    return fitted, days, other


SAID = "T_front − T_rear = -6 K (-1 … 1 K when the model was fitted)"


def test_compare_says_where_it_is_extrapolated_and_what_is_left_there(files):
    fitted, days, other = files
    done = abbe("compare", fitted, other)
    assert f"EXTRAPOLATED on 25 % of the rows: {SAID}" in done.out
    reported = json.loads(abbe("compare", fitted, other, "--json").out)["extrapolated"]
    assert reported["share"] == pytest.approx(OF_IT)
    assert [(b["name"], b["measured"], b["unit"]) for b in reported["beyond"]] == [
        ("T_front − T_rear", [-1.0, 1.0], "K")
    ]
    # a zero of their own in common: 12 µm on a quarter of the rows are 9 there and 3 elsewhere
    assert reported["lengths"]["rms"] == pytest.approx(9.0, abs=0.3)
    assert reported["lengths"]["rms_elsewhere"] == pytest.approx(3.0, abs=0.3)
    assert reported["rotations"] == {"rms": None, "rms_elsewhere": None}
    own = abbe("compare", fitted, days, "--json")
    assert json.loads(own.out)["extrapolated"] is None
    assert "EXTRAPOLATED" not in abbe("compare", fitted, days).out


def test_diagnose_says_it_beside_what_has_changed(files):
    fitted, days, other = files
    assert f"EXTRAPOLATED on 25 % of the rows: {SAID}" in abbe("diagnose", fitted, other).out
    assert "EXTRAPOLATED" not in abbe("diagnose", fitted, days).out


def test_a_point_and_a_file_of_points_say_it(files, tmp_path):
    fitted, _, _ = files
    where = ("X=100", "Z=200", "T_front=22")
    cool, usual = (
        json.loads(abbe("correct", fitted, *where, f"T_rear={t}", "--json").out) for t in (28, 22)
    )
    assert [b["name"] for b in cool["uncertainty"]["beyond"]] == ["T_front − T_rear"]
    assert usual["uncertainty"]["beyond"] == []
    assert cool["uncertainty"]["X"] > 10.0 * usual["uncertainty"]["X"]
    said = "T_front − T_rear = -6 K was not measured (-1 … 1 K)"
    assert any(w.startswith(said) for w in cool["warnings"])
    points, out = tmp_path / "in.csv", tmp_path / "out.csv"
    points.write_text("X,Z,T_front,T_rear\n100,200,22,22\n100,200,22,28\n", encoding="utf-8")
    done = abbe("correct", fitted, "--points", points, "-o", out, "--uncertainty")
    assert said in done.err
    rows = csv.DictReader(out.read_text("utf-8").splitlines())
    assert [row["not_measured"] for row in rows] == ["", "T_front-T_rear"]
