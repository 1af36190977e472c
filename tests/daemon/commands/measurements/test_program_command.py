"""abbe program: a program and its targets from a plan; nothing is written where it is refused."""

import re

import pytest

from tests.support.daemon.command_line import abbe

NEW = (
    "new", "--structure", "w b Y X Z t", "--travel", "Y=0,900", "--travel", "X=0,700",
    "--travel", "Z=-500,0", "--shape", "polynomial:1", "--play",
)  # fmt: skip


@pytest.fixture
def plan(tmp_path):
    assert abbe(*NEW, "-o", tmp_path / "m.toml").status == 0
    made = abbe("plan", tmp_path / "m.toml", "--preset", "iso230-2", "--time", "70min",
                "-o", tmp_path / "plan.toml")  # fmt: skip
    assert made.status == 0, made.err
    return tmp_path / "plan.toml"


def test_a_program_and_its_targets(plan, tmp_path):
    out, targets = tmp_path / "p.ngc", tmp_path / "t.csv"
    words = ("program", plan, "--controller", "linuxcnc", "-o", out, "--targets", targets)
    for _ in range(2):  # its own files may be overwritten
        done = abbe(*words)
        assert done.status == 0, done.err
    text = out.read_text("ascii")
    count = len(targets.read_text("utf-8").splitlines()) - 1
    assert text.count("(target ") == text.count("G4 P4") == count > 20
    assert text.count("G4 P0.5") > 2  # where it turns back to a target
    assert f"{count} targets" in done.out


def test_how_long_it_stands_at_a_target(plan, tmp_path):
    out = tmp_path / "p.ngc"
    words = ("program", plan, "--controller", "linuxcnc", "-o", out)
    assert abbe(*words).status == 0
    assert set(re.findall("G4 P.*", out.read_text("ascii"))) == {"G4 P4", "G4 P0.5"}
    assert abbe(*words, "--stands", "0.75").status == 0
    assert set(re.findall("G4 P.*", out.read_text("ascii"))) == {"G4 P0.75", "G4 P0.5"}
    assert abbe(*words, "--stands", "0").status == 2


def test_one_set_up_alone(plan, tmp_path):
    out = tmp_path / "p.h"
    done = abbe("program", plan, "--controller", "heidenhain", "-o", out, "--setup", "02_laser")
    assert done.status == 0, done.err
    assert out.read_text("ascii").count("STOP") == 2


@pytest.mark.parametrize(
    ("old", "new", "words", "says"),
    [
        ("", "", ("--controller", "mazak"), ("no such controller", "siemens")),
        ("", "", ("--controller", "siemens", "--setup", "zz"), ("no such set-up", "01_laser")),
        (
            "targets = [\n  [",
            "targets = [\n  [-5",
            ("--controller", "fanuc"),
            ("leave its travel",),
        ),
        ('model = "', 'model = "no-', ("--controller", "fanuc"), ("no-",)),
        ('format = "abbe-plan/1"', 'format = "x"', ("--controller", "fanuc"), ("format", "line 1")),
    ],
)
def test_what_is_refused_writes_nothing(plan, tmp_path, old, new, words, says):
    plan.write_text(
        plan.read_text("utf-8").replace(old, new, 1) if old else plan.read_text("utf-8")
    )
    out = tmp_path / "p.nc"
    done = abbe("program", plan, *words, "-o", out)
    assert done.status == 1
    for word in says:
        assert word in done.err
    assert not out.exists()


@pytest.mark.parametrize("artefact", ["step-gauge", "gauge-block", "ball-plate"])
def test_no_program_drives_into_what_a_probe_touches(plan, tmp_path, artefact):
    touched, out = tmp_path / "touched.toml", tmp_path / "p.ngc"
    made = abbe("plan", tmp_path / "m.toml", "--instruments", artefact, "--time", "70min",
                "-o", touched)  # fmt: skip
    assert made.status == 0, made.err
    done = abbe("program", touched, "--controller", "linuxcnc", "-o", out)
    assert done.status == 1
    assert "drive into them" in done.err
    assert "probing cycles" in done.err
    assert not out.exists()


def test_a_model_in_place_of_a_plan_is_called_so(plan, tmp_path):
    done = abbe("program", plan.parent / "m.toml", "--controller", "siemens",
                "-o", tmp_path / "p.mpf")  # fmt: skip
    assert done.status == 1
    assert "found 'abbe-model/1', expected 'abbe-plan/1'" in done.err
