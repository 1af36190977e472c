"""Plan, program, measure, fit on the simulated bridge: unseen lines are tenfold better.

The plan is Abbe's own, its program drives the machine, the laser obeys the exact chain. The lines
on which it is judged lie anywhere in the volume and were never measured.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from abbe.daemon.demo.prepare import START
from tests.support.daemon.command_line import abbe
from tests.support.daemon.measuring import (
    TOOL,
    Driver,
    bench,
    configuration,
    measuring,
    rms,
    unseen_lines,
)

pytestmark = [pytest.mark.integration, pytest.mark.timeout(1800)]

BRIEF = """
[measure]
still_for = 0.06
settle = 0.0
average = 0.1
"""


def start_model() -> str:
    """The demo's start model with fewer coefficients, and without expansion: the hall stays."""
    text = re.sub(r'shape = "spline:\d+"', 'shape = "spline:9"', START.read_text("utf-8"))
    parts = text.split("[[effects]]")
    return "[[effects]]".join(part for part in parts if "scale_expansion" not in part)


def one_way(plan: Path) -> None:
    """Once there is enough: this machine has no play, and the test is shorter."""
    text = plan.read_text("utf-8").replace("both_ways = true", "both_ways = false")
    plan.write_text(re.sub(r"^runs = \d+", "runs = 1", text, flags=re.MULTILINE), "utf-8")


@pytest.mark.thorough
def test_lines_never_measured_are_tenfold_better(tmp_path: Path) -> None:
    model, plan = tmp_path / "model.toml", tmp_path / "plan.toml"
    campaign, fitted = tmp_path / "campaign.csv", tmp_path / "fitted.toml"
    model.write_text(start_model(), "utf-8")
    tool = "P=" + ",".join(f"{x:g}" for x in TOOL)
    done = abbe("plan", model, "--instruments", "laser,straightness,angle,level", "--time", "10h",
                "--tool", tool, "-o", plan)  # fmt: skip
    assert done.status == 0, done.err
    one_way(plan)
    program = tmp_path / "plan.ngc"
    done = abbe("program", plan, "--controller", "linuxcnc", "-o", program)
    assert done.status == 0, done.err
    with bench() as process:
        config = configuration(process.ready, tmp_path, BRIEF)
        with measuring(plan, config, campaign) as run:
            run.until(lambda e: e["event"] == "next")
            machine = Driver(process, run, plan, model)
            assert program.read_text("ascii").count("(target ") == len(machine.targets)
            machine.all()
            assert run.wait() == 0, run.said
        done = abbe("fit", model, campaign, "-o", fitted)
        assert done.status == 0, done.err
        before, after = unseen_lines(process, fitted)
    assert rms(before) > 2.0
    assert rms(before) / rms(after) > 10.0
