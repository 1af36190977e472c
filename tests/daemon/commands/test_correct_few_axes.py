"""``abbe correct``, ``table`` and ``check`` of machines that lack some of X, Y, Z."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from tests.support.daemon.command_line import abbe

LATHE = """
format = "abbe-model/1"
[machine]
name = "Lathe"
structure = "w (C') b Z X t"
[machine.axes.Z]
travel = [-360, 0]
[machine.axes.X]
travel = [0, 700]
[[effects]]
kind = "angular"
axis = "Z"
about = "Z"
shape = "constant"
[effects.parameters]
value = {value = 40e-6}
[[effects]]
kind = "scale"
axis = "X"
[effects.parameters]
k = {value = 100e-6}
"""
ARM = """
format = "abbe-model/1"
[machine]
name = "Arm"
composition = "exact"
structure = "w b C C2 Z t"
[machine.axes.C]
travel = [-170, 170]
[machine.axes.C2]
travel = [-150, 150]
location = [300, 0, 0]
[machine.axes.Z]
travel = [-200, 0]
[[effects]]
kind = "rotary_positioning"
axis = "C2"
shape = "constant"
[effects.parameters]
value = {value = 1e-3}
"""


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lathe.toml").write_text(LATHE)
    (tmp_path / "arm.toml").write_text(ARM)

    def call(*args: str, code: int = 0) -> str:
        done = abbe(*args)
        assert done.status == code, done.out + done.err
        return done.out if code == 0 else done.err

    return call


def test_a_lathe_says_what_its_axes_take_back_and_what_stays(run):
    """Roll of 40 µrad over a lever of 200 mm: 8 µm in Y, which no axis moves."""
    answer = json.loads(run("correct", "lathe.toml", "X=200", "Z=-100", "--json"))
    assert answer["correction"] == pytest.approx({"X": 0.020, "Z": 0.0}, abs=1e-9)
    assert answer["left"] == pytest.approx({"Y": 0.008}, abs=1e-9)
    command = json.loads(run("correct", "lathe.toml", "X=200", "Z=-100", "--command", "--json"))
    assert command["correction"]["X"] == pytest.approx(-0.020, abs=1e-5)
    assert command["left"]["Y"] == pytest.approx(0.008, abs=1e-5)
    for more in ([], ["--command"]):
        text = run("correct", "lathe.toml", "X=200", "Z=-100", *more, "--report", "page.html")
        assert "along Y the machine has no axis: an error of 8.00 µm stays" in text.splitlines()
        page = Path("page.html").read_text()
        assert "error in Y, where no axis moves" in page
        # the parts are those of the error, whatever the question: no turned signs
        assert "The parts sum to the error there" in page


@pytest.mark.parametrize("command", [[], ["--command"]])
def test_points_of_a_lathe_have_columns_of_its_axes_alone(run, tmp_path, command):
    (tmp_path / "in.csv").write_text("X,Z\n200,-100\n0,-50\n")
    run("correct", "lathe.toml", "--points", "in.csv", "-o", "out.csv", *command)
    rows = list(csv.DictReader((tmp_path / "out.csv").read_text().splitlines()))
    assert list(rows[0]) == ["X", "Z", "X_corrected", "Z_corrected", "place_left_um"]
    sign = -1.0 if command else 1.0
    assert float(rows[0]["X_corrected"]) == pytest.approx(200.0 + sign * 0.020, abs=1e-5)
    assert float(rows[0]["place_left_um"]) == pytest.approx(8.0, abs=1e-2)
    assert float(rows[1]["place_left_um"]) == pytest.approx(0.0, abs=1e-3)


def test_tables_of_a_lathe_hold_its_axes(run, tmp_path):
    said = run("table", "lathe.toml", "--controller", "linuxcnc", "-o", "tables")
    assert "E_XX" in said
    assert "E_YZ" not in said
    assert "errors along Y, where the machine has no linear axis, are not counted" in said
    assert sorted(p.name for p in (tmp_path / "tables").glob("*.comp")) == ["x.comp", "z.comp"]


def test_an_arm_is_commanded_by_its_joints(run):
    said = run("correct", "arm.toml", "C=20", "C2=60", "Z=-50", "tool=550,0,-30", "--command")
    assert "C2         60.0000°         59.9427°   -1000.00 µrad" in said
    assert "the tool then stands 0.00 µm from where it should" in said


def test_an_arm_without_linear_axes_has_no_tables(run, tmp_path):
    text = ARM.replace(" Z t", " t").replace("[machine.axes.Z]\ntravel = [-200, 0]\n", "")
    (tmp_path / "joints.toml").write_text(text)
    refused = run("table", "joints.toml", "--controller", "csv", "-o", "tables", code=1)
    assert "no axis X, Y or Z that could carry a correction" in refused
    assert "abbe correct --command" in refused
    assert not (tmp_path / "tables").exists()
    said = run("correct", "joints.toml", "C=0", "C2=0", "tool=550,0,-30")
    assert "no linear axis moves that: --command says where to send the rotary axes" in said
