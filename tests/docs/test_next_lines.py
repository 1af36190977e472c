"""The lines that the pages of measuring, verifying and LinuxCNC give to be typed run as printed."""

from __future__ import annotations

import re
import shlex
import subprocess
from pathlib import Path

import pytest

from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.plan_file import read_plan
from tests.support.daemon import gauge_measuring, plate_measuring, sphere_measuring
from tests.support.daemon.command_line import abbe
from tests.support.daemon.gauge_measuring import BLOCK
from tests.support.daemon.measuring import LASER
from tests.support.daemon.verified_line import fitted, line, written

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
USAGE = re.compile(r"\[[^\[\]]*\](?:\.\.\.)?")


def section(page: str, title: str) -> str:
    """The text below a heading, up to the next one of its kind."""
    _, _, after = (DOCS / page).read_text("utf-8").partition(f"\n## {title}\n")
    assert after, title
    return after.partition("\n## ")[0]


def typed(text: str, verb: str) -> list[str]:
    """The commands of a verb in the code blocks of a text, as they are typed."""
    blocks = re.findall(r"^```\w*\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    lines = [ln.removeprefix("$ ") for block in blocks for ln in block.splitlines()]
    return [ln for ln in lines if ln.startswith(f"abbe {verb} ")]


def run(command: str, *more: str) -> str:
    done = abbe(*shlex.split(command)[1:], *more)
    assert done.status == 0, f"{command}\n{done.err}"
    return done.out


@pytest.mark.thorough
@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("title", "key"),
    [
        ("A ball plate that the machine touches", "ball-plate"),
        ("Gauge blocks and step gauges", "gauge-block"),
        ("A sphere on a rotary table", "sphere"),
    ],
)
def test_what_a_machine_touches_is_planned_as_the_page_says(
    title: str, key: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if key == "sphere":
        sphere_measuring.write_files(tmp_path, 1, (0.0, 90.0))
        (tmp_path / "plan.toml").unlink()
    elif key == "gauge-block":
        gauge_measuring.write_files(tmp_path, 1, BLOCK)
    else:
        plate_measuring.write_files(tmp_path, 1, 3, 130.0)
    (planning,) = typed(section("measure.md", title), "plan")
    assert f"--instruments {key} " in planning
    run(planning)
    setups = read_plan(tmp_path / "plan.toml", load_model(tmp_path / "model.toml").machine).setups
    assert {s.instrument.key for s in setups} == {key}


def test_a_plan_becomes_a_program_as_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = (DOCS / "measure.md").read_text("utf-8")
    gauge_measuring.write_files(tmp_path, 1, BLOCK)
    run("abbe plan model.toml --instruments laser --time 1h -o plan.toml")
    programming, touching = typed(text, "program")
    assert "--sphere" in touching  # test_programs_touching.py runs it
    run(programming)
    assert (tmp_path / "plan.nc").stat().st_size > 0


def test_a_sphere_on_a_trunnion_is_checked_as_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    turn = ["--travel", "A=-95,30", "--travel", "C=0,360"]
    where = ["--location", "A=250,200,-450", "--location", "C=250,200,-450"]
    made = abbe("new", "--structure", "w C' A' b X Y Z t", "--travel", "X=0,500", "--travel",
                "Y=0,400", "--travel", "Z=-400,0", *turn, *where, "-o", "fitted.toml")  # fmt: skip
    assert made.status == 0, made.err
    (checking,) = typed(section("measure.md", "A sphere that the control touches by a program"),
                        "verify")  # fmt: skip
    run(checking)
    setups = read_plan(tmp_path / "check.toml", load_model(tmp_path / "fitted.toml").machine).setups
    assert {s.axis for s in setups} == {"A", "C"}


def test_a_check_is_planned_and_judged_as_the_usage_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The lines of usage with every value that they show, and nothing left out."""
    monkeypatch.chdir(tmp_path)
    text = (DOCS / "verify.md").read_text("utf-8")
    block = text.partition("```\n")[2].partition("```")[0]
    judging, planning = re.split(r"^(?=abbe )", block, flags=re.MULTILINE)[1:]
    fitted(tmp_path)
    written(tmp_path / "after.csv", line("x_check", 310.0, scale=0.0))
    written(tmp_path / "before.csv", line("x_check", 310.0, scale=200.0))
    names = {"MODEL.toml": "m.toml", "AFTER.csv": "after.csv", "BEFORE.csv": "before.csv",
             "FIT.csv": "fit.csv", "NAME=x,y,z": "P=0,0,-80"}  # fmt: skip
    apart = ("--active", "--check ", "--tables", "--gauge", "--plate", "--keep-out")

    def words(usage: str) -> str:
        # those that need files of their own, or stand for each other
        kept = USAGE.sub(lambda m: "" if m[0][1:].startswith(apart) else m[0], usage)
        found = " ".join(re.sub(r"[\[\]]|\.\.\.", "", kept).split())
        for name, own in names.items():
            found = found.replace(name, own)
        return found

    run(words(planning))
    assert (tmp_path / "check.toml").exists()
    judged = abbe(*shlex.split(words(judging))[1:])
    assert judged.status in (0, 3, 4), judged.err
    assert '"outcome"' in judged.out
    assert (tmp_path / "CERTIFICATE.html").exists()


def test_a_mill_is_made_ready_to_be_calibrated_as_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bare model, and the files without which LinuxCNC does not start."""
    monkeypatch.chdir(tmp_path)
    text = section("linuxcnc.md", "Calibrating")
    (making,) = typed(text, "new")
    run(making)
    assert not load_model(tmp_path / "model.toml").effects
    (same,) = typed(section("calibrate.md", "With tables"), "new")
    assert same == making
    (calibrating,) = typed(text, "calibrate")
    sample = (ROOT / "drivers" / "linuxcnc" / "sample.toml").read_text("utf-8")
    config = "".join(own for own in sample.splitlines(keepends=True) if "T_spindle" not in own)
    (tmp_path / "mill.toml").write_text(config + LASER.format(port="/dev/none"), encoding="utf-8")
    run(calibrating, "--yes", "--upto", "program")
    assert "G53 G1" in (tmp_path / "calibration" / "program.nc").read_text("ascii")
    shell = next(b for b in text.split("```\n") if b.startswith("mkdir "))
    subprocess.run(["sh", "-ec", shell], check=True, cwd=tmp_path)
    for axis in "xyz":
        assert (tmp_path / "comp" / "current" / f"{axis}.comp").read_text() == "0 0 0\n"


def test_a_machine_that_only_probes_is_led_as_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    gauge_measuring.write_files(tmp_path, 1, BLOCK)
    (tmp_path / "config.toml").rename(tmp_path / "cmm.toml")
    (calibrating,) = typed(section("calibrate.md", "A machine that only probes"), "calibrate")
    run(calibrating, "--yes", "--upto", "plan")
    plan = tmp_path / "calibration" / "plan.toml"
    (key,) = {s.instrument.key for s in read_plan(plan, load_model("model.toml").machine).setups}
    assert key == "gauge-block"
