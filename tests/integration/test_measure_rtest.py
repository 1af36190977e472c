"""A five-axis machine by R-test: planned, programmed, measured, fitted, against its exact chain."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.plan_file import read_plan
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.motion import steps_of
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.command_line import abbe
from tests.support.daemon.measuring import MeasureRun, measuring

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

LOOK = 0.05
"""s for the display to be read before it shows another place."""
AGAIN = 4.0
"""s after which a target that is not read is come to again."""
MODEL = """format = "abbe-model/1"
[machine]
name = "Trunnion"
structure = "w C' A' b X Y Z t"
[machine.axes]
X = { travel = [0.0, 500.0] }
Y = { travel = [0.0, 400.0] }
Z = { travel = [-400.0, 0.0] }
A = { travel = [-95.0, 30.0], location = [250.0, 200.0, -450.0] }
C = { travel = [0.0, 360.0], location = [250.0, 200.0, -450.0] }
"""
EFFECTS = "".join(
    f'[[effects]]\nkind = "{kind}"\naxis = "{axis}"\n{shape}'
    for axis, shape in (("A", 'shape = "polynomial:2"\n'), ("C", ""))
    for kind, shape in (("rotary_location", ""), ("rotary_positioning", shape))
)
CONFIG = """format = "abbe-config/1"
model = "model.toml"
[guard]
max_correction = 0.1
max_rate = 0.5
stale_after = 5.0
signals_stale_after = 5.0
AXES
[links.mill]
driver = "serial"
port = "DISPLAY"
timeout = 2.0
[links.mill.messages.all]
query = "R"
pattern = 'X(?P<x>\\S+) Y(?P<y>\\S+) Z(?P<z>\\S+) A(?P<a>\\S+) C(?P<c>\\S+)'
[links.mill.channels]
x = { message = "all", unit = "mm" }
y = { message = "all", unit = "mm" }
z = { message = "all", unit = "mm" }
a = { message = "all", unit = "deg" }
c = { message = "all", unit = "deg" }
[links.nest]
driver = "serial"
port = "RTEST"
timeout = 2.0
[links.nest.messages.three]
query = "R"
pattern = '(?P<x>[-+.\\d]+) (?P<y>[-+.\\d]+) (?P<z>[-+.\\d]+)'
[links.nest.channels]
x = { message = "three", unit = "mm" }
y = { message = "three", unit = "mm" }
z = { message = "three", unit = "mm" }
[instrument.r-test]
source = ["nest.x", "nest.y", "nest.z"]
reads = "error"
jump = 500
[measure]
still_for = 0.05
settle = 0.0
average = 0.1
"""


@pytest.fixture
def shop(tmp_path: Path) -> Iterator[tuple[SimulatedProcess, Path]]:
    with SimulatedProcess("trunnion") as process:
        text = CONFIG.replace("DISPLAY", process.ready["display"])
        text = text.replace("RTEST", process.ready["rtest"])
        axes = "".join(f'[axes.{a}]\nsource = "mill.{a.lower()}"\n' for a in "XYZAC")
        (tmp_path / "config.toml").write_text(text.replace("AXES\n", axes), encoding="utf-8")
        (tmp_path / "model.toml").write_text(MODEL, encoding="utf-8")
        yield process, tmp_path


@pytest.mark.thorough
def test_rotary_axes_by_r_test_from_the_plan_to_the_fit(
    shop: tuple[SimulatedProcess, Path],
) -> None:
    process, folder = shop
    model, plan, out = folder / "start.toml", folder / "plan.toml", folder / "day.csv"
    model.write_text(MODEL + EFFECTS, encoding="utf-8")
    done = abbe("plan", model, "--instruments", "r-test", "--time", "1h",
                "--tool", "R=0,0,-120", "-o", plan)  # fmt: skip
    assert done.status == 0, done.err
    machine = load_model(model).machine
    work = read_plan(plan, machine)
    # one placing for each axis is enough here
    by_axis = {s.axis: s for s in reversed(work.setups)}
    setups = [s for s in work.setups if by_axis[s.axis] is s]
    assert {s.axis for s in work.setups} == {"A", "C"}
    done = abbe("program", plan, "--controller", "siemens", "-o", folder / "day.mpf")
    assert done.status == 0, done.err
    steps = list(steps_of(machine, setups, work.space))
    count = sum(step.kind == "target" for step in steps)
    program = (folder / "day.mpf").read_text("utf-8")
    assert len(re.findall(r"target \d+", program)) >= count
    waiting = iter(setups)
    names = [word for s in setups for word in ("--setup", s.name)]
    with measuring(plan, folder / "config.toml", out, *names) as run:
        run.until(lambda e: "stands" in e["text"])  # it looks
        rows = 0
        before: dict[str, float] = {}
        for step in steps:
            if step.kind == "stop":
                setup = next(waiting)
                # nobody puts the sphere exactly where it is to stand
                place = np.add(setup.optics["the sphere stands"], (0.08, -0.05, 0.03))
                process.order("sphere", at=place.tolist())
            elif step.kind == "move":
                last, before = before, shown(step.at)
                drive(process, before)
            elif step.kind == "target":
                rows += 1
                while len(run.kinds("row")) < rows:
                    # a busy computer may not have seen from which side it came: once more
                    if not waited(run, rows):
                        drive(process, last)
                        drive(process, before)
        assert run.wait() == 0, run.said
    found = read_campaign(out, machine)
    assert found.n == 3 * count
    fitted = folder / "fitted.toml"
    done = abbe("fit", model, out, "--cautious", "-o", fitted)
    assert done.status == 0, done.err
    assert "the line of C lies" in done.out
    assert left_elsewhere(process, fitted) < 0.15 * left_elsewhere(process, None)


def shown(at: Mapping[str, float]) -> dict[str, float]:
    """Positions as a display shows them."""
    return {a: float(np.degrees(q)) if is_rotary(a) else q for a, q in at.items()}


def drive(process: SimulatedProcess, to: Mapping[str, float]) -> None:
    """Have the axes stand elsewhere, for long enough to be looked at."""
    process.order("go", to=dict(to))
    time.sleep(LOOK)


def waited(run: MeasureRun, rows: int) -> bool:
    """Whether so many targets are read within a while."""
    until = time.monotonic() + AGAIN
    while len(run.kinds("row")) < rows and time.monotonic() < until:
        time.sleep(0.01)
    return len(run.kinds("row")) >= rows


def left_elsewhere(process: SimulatedProcess, model: Path | None) -> float:
    """RMS of the exact machine's errors at poses never measured, less their mean, mm."""
    rng = np.random.default_rng(4)
    poses = [
        {"X": 250.0, "Y": 200.0, "Z": -200.0, "A": a, "C": c}
        for a, c in zip(rng.uniform(-85, 25, 30), rng.uniform(0, 360, 30), strict=True)
    ]
    errors = []
    for pose in poses:
        process.order("go", to=pose)
        errors.append(process.order("truth")["error"])
    left = np.array(errors)
    if model is not None:
        at = {a: np.array([p[a] for p in poses]) for a in "XYZAC"}
        at |= {a: np.radians(at[a]) for a in "AC"}
        tool = np.tile((0.0, 0.0, -120.0), (len(poses), 1))
        left = left - load_model(model).predict(Conditions(at, tool=tool)).translation
    return float(np.sqrt(np.mean((left - left.mean(axis=0)) ** 2)))
