"""Faults in the upload and the verification of ``abbe calibrate``: the same command goes on."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from abbe.daemon.calibration.state import CalibrationState
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.command_line import Done, abbe
from tests.support.daemon.upload_cases import QUICK, SLOW, TRAVELS, Place, sums, texts

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

MEASURE = """
[instrument.laser]
source = "cnc.x"
reads = "length"
[measure]
active = "none"
"""


@pytest.fixture(scope="module")
def control() -> Iterator[SimulatedProcess]:
    with SimulatedProcess("controller", "modbus") as process:
        yield process


@pytest.fixture
def place(made: Path, control: SimulatedProcess, tmp_path: Path) -> Place:
    """A calibration that is measured, and a control with tables that do nothing."""
    shutil.copy(made / "model.toml", tmp_path)
    control.order("reset")
    keys = {"driver": "modbus", "host": "127.0.0.1", "port": control.ready["port"]}
    here = Place(tmp_path, control, keys, SLOW)
    configure(here, **SLOW)
    done = calibrate(here, "--upto", "plan")
    assert done.status == 0, done.err
    write_lines(tmp_path / "c" / "campaign.csv")
    note(here, "measure", "plan.toml")
    done = calibrate(here, "--upto", "table")
    assert done.status == 0, done.err + done.out
    return here


def configure(place: Place, **keys: object) -> None:
    place.configure(**keys)
    with place.config.open("a") as file:
        file.write(MEASURE)


def words(place: Place, *more: str) -> list[str]:
    return ["calibrate", str(place.config), "--folder", str(place.folder / "c"), "--time", "2h",
            "--tables", "csv", "--yes", "--tool", "P=0,0,-100", *more]  # fmt: skip


def calibrate(place: Place, *more: str) -> Done:
    return abbe(*words(place, *more))


def note(place: Place, step: str, *made_from: str) -> None:
    """Say that a step was done: what it makes was written by the test."""
    folder = place.folder / "c"
    state = CalibrationState.read(folder, place.config)
    state.note(step, [folder / name for name in made_from])


def steps_done(place: Place) -> list[str]:
    state = json.loads((place.folder / "c" / "calibration.json").read_text("utf-8"))
    return list(state["steps"])


def write_lines(path: Path) -> None:
    """A laser along each axis, there and back twice: a screw that is wrong, and play."""
    rows = ["time,setup,kind,X,Y,Z,X_dir,Y_dir,Z_dir,ux,uy,uz,value,sd"]
    for k, (axis, (low, high)) in enumerate(TRAVELS.items()):
        for run in range(2):
            for sense in (1, -1):
                for i in range(21) if sense > 0 else range(20, -1, -1):
                    at = [0.5 * (a + b) for a, b in TRAVELS.values()]
                    at[k] = low + (high - low) * i / 20.0
                    value = 8.0 * math.sin(at[k] / 90.0) + 1.5 * sense + 0.1 * ((i * 7 + run) % 3)
                    come = ["0", "0", "0"]
                    come[k] = str(sense)
                    u = ["0", "0", "0"]
                    u[k] = "1"
                    rows.append(
                        ",".join([str(len(rows)), f"{axis}_line", "displacement",
                                  *(f"{v:g}" for v in at), *come, *u, f"{value:.3f}", "0.2"])
                    )  # fmt: skip
    head = '# format = "abbe-campaign/1"\n# machine = "mill"\n# instrument = "laser"\n'
    path.write_text(head + "\n".join(rows) + "\n", encoding="utf-8")


@pytest.mark.thorough
def test_a_controller_that_refuses_and_a_link_that_is_lost_leave_the_old_tables(
    place: Place, made: Path
) -> None:
    place.control.order("load", files=texts(made / "old"))
    old = sums(made / "old")
    for fault in ({"kind": "refuses", "at": "commit"}, {"kind": "hang", "at": "block", "skip": 2}):
        configure(place, **QUICK)
        place.control.order("fault", **fault)
        done = calibrate(place, "--upto", "upload")
        assert done.status == 1, done.out
        assert "upload is not done; the steps before it are" in done.out
        assert "upload" not in steps_done(place)
        assert place.truth()["active"] == old
        place.control.order("clear")
        place.control.order("wake")
    configure(place, **SLOW)
    done = calibrate(place, "--upto", "upload")
    assert done.status == 0, done.err + done.out
    assert "table: tables for the controller: done" in done.out
    assert place.truth()["active"] == sums(place.folder / "c" / "tables")
    # what was uploaded is not uploaded again
    before = len(place.entries())
    assert calibrate(place, "--upto", "upload").status == 0
    assert len(place.entries()) == before


@pytest.mark.one_in(2)
@pytest.mark.parametrize("at", [{"at": "block", "skip": 2}, {"at": "commit", "kind": "hang_after"}])
def test_killed_in_the_upload_it_is_recovered_and_goes_on(
    place: Place, made: Path, at: dict[str, object]
) -> None:
    place.control.order("load", files=texts(made / "old"))
    place.control.order("fault", **({"kind": "hang"} | at))
    with subprocess.Popen(
        [sys.executable, "-m", "abbe.daemon", *words(place, "--upto", "upload")],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        until = time.monotonic() + 100.0
        while not place.truth()["happened"]:
            assert process.poll() is None
            assert time.monotonic() < until
            time.sleep(0.02)
        os.kill(process.pid, signal.SIGKILL)
    place.control.order("clear")
    place.control.order("wake")
    assert "upload" not in steps_done(place)
    done = calibrate(place, "--upto", "upload")
    assert done.status == 0, done.err + done.out
    assert place.truth()["active"] == sums(place.folder / "c" / "tables")
    assert {e["upload"] for e in place.entries()} == {
        e["upload"] for e in place.entries() if e["step"] == "end"
    }


def write_check(plan: Path, path: Path) -> None:
    """What the lines of a check plan showed with the tables active."""
    rows = ["time,setup,kind,X,Y,Z,X_dir,Y_dir,Z_dir,tool_x,tool_y,tool_z,ux,uy,uz,value,sd"]
    for setup in tomllib.loads(plan.read_text("utf-8"))["setups"]:
        targets, u = setup["targets"], setup["read"][0][0]
        for run in range(setup["runs"]):
            for sense in (1, -1):
                for i in range(len(targets))[::sense]:
                    at = dict(zip(setup["axes"], targets[i], strict=True))
                    come = [sense * (1 if v > 0 else -1 if v < 0 else 0) for v in u]
                    numbers = [len(rows), *(at[a] for a in "XYZ"), *come, 0.0, 0.0, -100.0, *u]
                    head = [str(numbers[0]), setup["name"], "displacement"]
                    value = 0.2 * ((i * 5 + run) % 3)
                    rows.append(",".join([*head, *(f"{v:g}" for v in numbers[1:]), f"{value},0.2"]))
    head = '# format = "abbe-campaign/1"\n# machine = "mill"\n# instrument = "laser"\n'
    path.write_text(head + "\n".join(rows) + "\n", encoding="utf-8")


def test_a_certificate_that_cannot_be_written_and_then_can(place: Place) -> None:
    assert calibrate(place, "--upto", "check-plan").status == 0
    folder = place.folder / "c"
    write_check(folder / "check.toml", folder / "check.csv")
    note(place, "check", "check.toml")
    (folder / "certificate.html").mkdir()
    done = calibrate(place)
    assert done.status == 1
    assert "verify is not done; the steps before it are" in done.out
    (folder / "certificate.html").rmdir()
    done = calibrate(place)
    assert done.status == 0, done.err
    page = (folder / "certificate.html").read_text("utf-8")
    assert page.lower().startswith("<!doctype html>")
    assert page.rstrip().endswith("</html>")
    assert f"calibrated: {folder}; verified" in done.out
