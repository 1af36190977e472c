"""``abbe calibrate`` with tables on a real LinuxCNC: from the plan to a machine ten times better.

LinuxCNC runs the program with its own interpreter; a laser on a serial line reads where the tip
really is, from a plant behind LinuxCNC's motors that knows nothing of Abbe (`plant.py`); the tables
are uploaded, LinuxCNC is started anew, other lines are measured. No file is touched by hand.
"""

from __future__ import annotations

import json
import subprocess
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tests.support.daemon.command_line import abbe
from tests.support.drivers.linuxcnc.calibrating import ProgramRun, calibrating
from tests.support.drivers.linuxcnc.measured_mill import MeasuredMill

pytestmark = [pytest.mark.integration, pytest.mark.calibration, pytest.mark.timeout(900)]

TRAVELS = {"X": (-150.0, 150.0), "Y": (-100.0, 100.0), "Z": (-120.0, 0.0)}
CONFIG = """
format = "abbe-config/1"
model = "model.toml"

[cycle]
period = 0.02

[links.mill]
driver = "linuxcnc"
timeout = 10.0
servo_silence = 10.0
[links.mill.channels]
X = {{ pin = "joint.0.pos-cmd", unit = "mm" }}
Y = {{ pin = "joint.1.pos-cmd", unit = "mm" }}
Z = {{ pin = "joint.2.pos-cmd", unit = "mm" }}
state = {{ word = "state" }}

[links.laser]
driver = "serial"
port = "laser"
timeout = 10.0
[links.laser.messages.reading]
query = "R"
pattern = '(?P<status>OK|BEAM)( (?P<length>[-+.\\d]+))?'
[links.laser.channels]
length = {{ message = "reading", unit = "mm" }}
beam = {{ message = "reading", field = "status", values = {{ OK = 1, BEAM = 0 }} }}

[instrument.laser]
source = "laser.length"
beam = "laser.beam"
reads = "length"
stale_after = 10.0

[measure]
still_for = 0.06
settle = 0.02
average = 0.15
active = "none"

[controller]
status = "mill.state"
require = 3

[guard]
max_correction = 0.1
max_rate = 0.5
stale_after = 10.0

[axes.X]
source = "mill.X"
[axes.Y]
source = "mill.Y"
[axes.Z]
source = "mill.Z"

[upload]
controller = "linuxcnc"
identity = {identity}
max_entry_um = 100.0
max_change_um = 100.0
effect_tolerance_um = 0.3
effect_looks = 2
[upload.store]
driver = "linuxcnc"
ini = "mill.ini"
restart = {restart}
verify_by_moving = true
verify_step = 3.0
verify_feed = 3000.0
"""


def write_configuration(mill: MeasuredMill) -> Path:
    version = subprocess.run(
        ["/usr/bin/python3", "-c", "import linuxcnc; print(linuxcnc.version)"],
        capture_output=True, text=True, check=True,
    ).stdout.strip()  # fmt: skip
    config = mill.folder / "mill.toml"
    config.write_text(
        CONFIG.format(
            identity=json.dumps(f"LinuxCNC {version}, mill"),
            restart=json.dumps(mill.restart_command()),
        )
    )
    return config


def write_model(path: Path) -> None:
    travels = [w for a, (low, high) in TRAVELS.items() for w in ("--travel", f"{a}={low},{high}")]
    done = abbe("new", "--structure", "w b X Y Z t", "--name", "mill", *travels, "--bare",
                "-o", path)  # fmt: skip
    assert done.status == 0, done.err


def unseen_lines() -> np.ndarray:
    """Points along lines anywhere in the volume, there and back."""
    rng = np.random.default_rng(11)
    low, high = (np.array([TRAVELS[a][k] for a in "XYZ"]) for k in (0, 1))
    ends = low + rng.uniform(0.03, 0.97, (4, 3)) * (high - low)
    parts = np.linspace(0.0, 1.0, 7)[:, None]
    there = np.concatenate([a + parts * (b - a) for a, b in pairwise(ends)])
    return np.concatenate([there, there[::-1]])


def worst(errors: np.ndarray) -> float:
    """Longest error vector but for one shift of all, µm."""
    return 1e3 * float(np.linalg.norm(errors - errors.mean(axis=0), axis=1).max())


WORDS = (
    "calibrate", "mill.toml", "--time", "70min", "--check-time", "26min", "--controller",
    "linuxcnc", "--tables", "linuxcnc", "--feed", "12000", "--stands", "0.1", "--yes",
)  # fmt: skip


def test_a_mill_is_calibrated_by_its_own_program_and_tables() -> None:
    with MeasuredMill() as mill, mill.place_laser():
        folder, made = mill.folder, mill.folder / "calibration"
        write_configuration(mill)
        write_model(folder / "model.toml")
        mill.ready()
        points = unseen_lines()
        before = worst(mill.walk(points))
        with calibrating(folder, *WORDS, "--upto", "table") as run:
            run.until("set up 01_")
            first = (made / "program.nc", made / "plan.toml", made / "campaign.csv")
            ProgramRun(mill, *first).drive(run)
            assert run.wait() == 0, run.said
        with calibrating(folder, *WORDS) as run:  # it goes on where it was stopped
            run.until("11/12 check:")
            mill.forget_operator()  # LinuxCNC was started anew
            run.until("these lines measured")
            second = (made / "check.nc", made / "check.toml", made / "check.csv")
            ProgramRun(mill, *second).drive(run)
            assert run.wait() == 0, run.said
        after = worst(mill.walk(points))
        print(f"worst error on unseen lines: {before:.1f} µm before, {after:.2f} µm after")
        assert before > 15.0
        assert before / after > 10.0
        assert "the controller adds what the table says" in run.said
        assert (made / "certificate.html").exists()
        # the tables act now: who says that none do would fit what they leave as the machine
        again = (*WORDS, "--folder", "again", "--upto", "measure")
        with calibrating(folder, *again) as refused:
            assert refused.wait() == 1
            assert "tables act in the controller" in refused.said
