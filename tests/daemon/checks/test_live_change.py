"""A machine that has crashed, found by the controller's own probing: the alarm, and what to do."""

from __future__ import annotations

import asyncio
import io
import logging
import os
import re
import subprocess
import sys
from datetime import datetime
from pathlib import Path

import pytest
from rich.console import Console

from abbe.compcore.files.campaign_file import read_campaign, write_campaign
from abbe.compcore.files.model_file import load_model
from abbe.daemon.show.screen import LiveScreen
from abbe.daemon.status.status_source import StatusSource
from abbe.daemon.status.text import lines
from abbe.drivers.simulated.bridge.checks import SPHERES
from abbe.drivers.simulated.bridge.machine import AXES, PLACES, TOOL
from tests.support.daemon.checked_bridge import fitted_bridge, year
from tests.support.daemon.command_line import abbe
from tests.support.daemon.probing_plc import ProbingPlc, looked_at, probing, sphere, until

pytestmark = pytest.mark.timeout(300)

AT = 40
"""Sound checks before the crash; two more were measured since."""


async def test_the_alarm_its_fields_and_the_command_that_it_prints(tmp_path, caplog) -> None:
    """The third check after the crash is the controller's; the two before are in the record."""
    caplog.set_level(logging.INFO, "abbe.checks")
    model = fitted_bridge(tmp_path)
    loaded = load_model(model)
    # what was measured until yesterday; the last of it is measured today, by the controller
    history = year(tmp_path, "crash", checks=123)
    rows = read_campaign(history, loaded.machine)
    time = rows.conditions.time
    newest = time > time.max() - 3600.0
    since = time.min() + (120 - AT) // 5 * 7 * 86400.0
    write_campaign(rows.rows((time > since) & ~newest), tmp_path / "history.csv")
    kept = ["--checks", tmp_path / "checks.csv"]
    done = abbe("check-point", model, "--campaign", tmp_path / "history.csv", "--lasting", *kept)
    assert done.status == 0, done.err
    first = read_campaign(tmp_path / "checks.csv", loaded.machine)
    today = rows.rows(newest)

    def read(campaign, name: str) -> list[float]:
        """Errors of a sphere in X, Y, Z, mm."""
        setup = [str(s) for s in campaign.conditions.setup]
        return [float(campaign.value[setup.index(f"{name}_{a}")]) for a in "XYZ"]

    shown = {p: float(today.conditions.signals[p][0]) for p in PLACES}
    plc = ProbingPlc({"X": 300.0, "Y": 400.0, "Z": -100.0, **shown}, tuple(SPHERES))
    tool = f"tool = {list(TOOL)}\nsd = 0.5"
    sections = "\n".join(sphere(name, tool) for name in SPHERES)
    async with probing(plc, model, sections, tmp_path) as (service, _):
        await until(lambda: service.checks.state.answer is not None)
        assert service.checks.state.answer["verdict"] == "sound"
        await until(lambda: looked_at(service))
        for name, place in SPHERES.items():
            stands = [q + e for q, e in zip(place, read(first, name), strict=True)]
            found = [q - e for q, e in zip(stands, read(today, name), strict=True)]
            plc.measured(name, *found)
        await until(lambda: service.checks.state.changed)
        status = StatusSource(service)()
        axes = service.pipeline.axes
        screen = LiveScreen(loaded.machine, axes, AXES, {}, "", checks=service.checks)
        screen(service.logbook.cycles.latest)
        console = Console(file=io.StringIO(), width=120)
        console.print(screen.picture(120))
        drawn = console.file.getvalue()
    assert status.checks.verdict == "changed"
    assert (status.checks.component, status.checks.along) == (["Y"], ["X"])
    assert "THE MACHINE HAS CHANGED" in drawn
    text = list(lines(status))
    assert any(
        line.startswith("THE MACHINE HAS CHANGED") and "in Y, grows with X" in line for line in text
    )
    (record,) = [r for r in caplog.records if getattr(r, "event", "") == "machine changed"]
    assert record.about["COMPONENT"] == ["Y"]
    assert record.about["ALONG"] == ["X"]
    assert datetime.fromisoformat(record.about["LAST_SOUND"]) < datetime.fromisoformat(
        record.about["FIRST_CHANGED"]
    )
    said, _, command = record.getMessage().partition(" next: ")
    assert said == status.checks.words[0]
    assert command == status.checks.next
    done = await asyncio.to_thread(in_a_shell, command)
    assert re.search(r"squareness axes=Y,X .*changed (since|\(against the model of) 20\d\d-", done)


def in_a_shell(command: str) -> str:
    """As a person types it, from another folder."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-ec", command],
        cwd="/",
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
