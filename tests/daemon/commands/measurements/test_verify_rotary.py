"""abbe verify on a machine with a rotary table: its angle is planned, programmed, judged."""

from __future__ import annotations

import json
import tomllib
from math import radians, sin
from pathlib import Path

import numpy as np
import pytest

from tests.support.daemon.command_line import abbe

MODEL = """format = "abbe-model/1"
[machine]
name = "Mill with a table"
structure = "w C' b X Y Z t"
reference_temperature = 20.0
[machine.axes]
X = { travel = [0.0, 500.0] }
Y = { travel = [0.0, 400.0] }
Z = { travel = [-400.0, 0.0] }
C = { travel = [0.0, 360.0], location = [250.0, 200.0, -450.0] }
[[effects]]
kind = "rotary_positioning"
axis = "C"
shape = "spline:8"
"""
AMPLITUDE = 40.0
"""Of the table's error of angle, µrad."""
PLAY = 6.0
"""By which the corrected table stands beside that when it comes from above, µrad."""


def write_turns(
    path: Path, angles: list[float], runs: int, name: str, amplitude: float, play: float = 0.0
) -> None:
    """A rotary calibrator's readings at angles (degrees), there and back."""
    rows = ["time,setup,kind,X,Y,Z,C,X_dir,Y_dir,Z_dir,C_dir,ux,uy,uz,value,sd"]
    for _ in range(runs):
        for sense in (1, -1):
            for angle in angles[::sense]:
                value = amplitude * sin(radians(angle)) - (play if sense < 0 else 0.0)
                rows.append(
                    f"{len(rows)},{name},rotation,250,200,-200,{angle},0,0,0,{sense},0,0,1,{value},2"
                )
    head = '# format = "abbe-campaign/1"\n# instrument = "rotary calibrator"\n'
    path.write_text(head + "\n".join(rows) + "\n", encoding="utf-8")


@pytest.fixture
def shop(tmp_path: Path) -> Path:
    (tmp_path / "start.toml").write_text(MODEL, encoding="utf-8")
    write_turns(tmp_path / "fit.csv", [15.0 * i for i in range(24)], 2, "c_fit", AMPLITUDE)
    done = abbe("fit", tmp_path / "start.toml", tmp_path / "fit.csv", "-o", tmp_path / "m.toml")
    assert done.status == 0, done.err
    return tmp_path


def test_a_rotary_axis_is_in_the_plan_its_program_and_the_certificate(shop: Path) -> None:
    check = shop / "check.toml"
    done = abbe("verify", shop / "m.toml", "-o", check, "--instruments", "laser,rotary-calibrator",
                "--time", "8h", "--runs", "2", "--tool", "P=0,0,-100")  # fmt: skip
    assert done.status == 0, done.err
    setups = tomllib.loads(check.read_text("utf-8"))["setups"]
    assert {s["axis"] for s in setups if "axis" in s} >= {"X", "Y", "Z", "C"}
    (turn,) = (s for s in setups if s["instrument"] == "rotary-calibrator")
    angles = [row[turn["axes"].index("C")] for row in turn["targets"]]
    # other angles than were fitted, but for the ends of the travel
    assert sum(min(abs(a - 15.0 * i) for i in range(25)) < 0.01 for a in angles) <= 2
    assert np.ptp(angles) > 330.0
    done = abbe("program", check, "--controller", "linuxcnc", "-o", shop / "check.ngc")
    assert done.status == 0, done.err
    assert f"C{angles[3]:.4f}".rstrip("0") in (shop / "check.ngc").read_text("ascii")
    # measured with the table corrected: a tenth is left
    write_turns(shop / "after.csv", angles, 2, turn["name"], 0.1 * AMPLITUDE, PLAY)
    write_turns(shop / "before.csv", angles, 2, turn["name"], AMPLITUDE)
    report = shop / "certificate.html"
    done = abbe("verify", shop / "m.toml", shop / "after.csv", "--before", shop / "before.csv",
                "--tolerance", "C.E=30urad", "--instrument", "rotary-calibrator", "--report",
                report, "--json")  # fmt: skip
    found = json.loads(done.out)
    (line,) = found["lines"]
    assert (line["line"], line["unit"]) == ("C", "urad")
    for state, left, play in (("before", 1.0, 0.0), ("after", 0.1, PLAY)):
        values = left * AMPLITUDE * np.sin(np.radians(angles))
        wanted = values.max() - (values.min() - play)
        assert line[state]["E"]["value"] == pytest.approx(wanted, abs=1e-6)
        assert line[state]["B"]["value"] == pytest.approx(play, abs=1e-6)
    assert line["foretold"]["agrees"]
    # 96 readings of 2 µrad determine 8 coefficients: the mean variance foretold is 8/96 of theirs,
    # and E is the difference of two places
    sd = line["foretold"]["figures"]["E"]["sd"]
    assert sd == pytest.approx(2.0 * np.sqrt(2.0 * 8.0 / 96.0), rel=0.3)
    assert found["outcome"] == "passes"
    page = report.read_text("utf-8")
    assert "µrad" in page
    assert "rotary calibrator" in page
    # judged with the check plan, what was not measured is no pass
    done = abbe("verify", shop / "m.toml", shop / "after.csv", "--before", shop / "before.csv",
                "--tolerance", "C.E=30urad", "--check", check)  # fmt: skip
    assert done.status == 4


def test_a_plan_weighs_the_calibrator(shop: Path) -> None:
    done = abbe("plan", shop / "start.toml", "--instruments", "rotary-calibrator,r-test", "--time",
                "3h", "-o", shop / "plan.toml")  # fmt: skip
    assert done.status == 0, done.err
    setups = tomllib.loads((shop / "plan.toml").read_text("utf-8"))["setups"]
    turn = next(s for s in setups if s["instrument"] == "rotary-calibrator")
    assert turn["kind"] == "rotation"
    assert turn["read"] == [[[0.0, 0.0, 1.0]]]
