"""``abbe run --json`` with positions and temperatures of an MTConnect agent."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from abbe.compcore.files.model_file import load_model
from abbe.compcore.machine.conditions import Conditions
from tests.support.drivers.mtconnect.agent import MillAgent

pytestmark = pytest.mark.integration

MODEL = Path(__file__).parents[3] / "examples" / "bridge-cmm" / "model.toml"
PATIENCE = 90.0
PLACE = {"X": 350.0, "Y": 450.0, "Z": -180.0}
TOOL = (0.0, 0.0, -150.0)

CONFIG = f"""\
format = "abbe-config/1"
model = "{MODEL}"
[cycle]
period = 0.05
[guard]
max_correction = 0.1
max_rate = 0.5
stale_after = 3.0
signals_stale_after = 20.0
[tool]
offset = {list(TOOL)}
[links.mill]
driver = "mtconnect"
url = "URL"
timeout = 2.0
stamp = "none"
reconnect_max = 0.5
[links.mill.channels]
x = {{ data = "Xact", unit = "mm" }}
y = {{ data = "Yact", unit = "mm" }}
z = {{ data = "Zact", unit = "mm" }}
T = {{ data = "Stemp", unit = "degC" }}
"""
AXES = "".join(f'[axes.{axis}]\nsource = "mill.{axis.lower()}"\n' for axis in "XYZ")
SIGNALS = "".join(f'[signals.T_{a}{n}]\nsource = "mill.T"\n' for a in "xyz" for n in (1, 2))


def until(run: subprocess.Popen[str], right: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The first cycle that is as wanted."""
    assert run.stdout is not None
    deadline = time.monotonic() + PATIENCE
    last = ""
    for last in run.stdout:
        found: dict[str, Any] = json.loads(last)
        if right(found):
            return found
        if time.monotonic() > deadline:
            break
    raise AssertionError(last)


def in_full(cycle: dict[str, Any]) -> bool:
    guard = cycle["guard"]
    return bool(guard["compensating"] and not guard["rate_limited"])


def test_positions_that_are_missing_end_the_correction(agent: MillAgent, tmp_path: Path) -> None:
    agent.say(Stemp=22.5, **{f"{axis}act": at for axis, at in PLACE.items()})
    config = tmp_path / "config.toml"
    url = f"http://127.0.0.1:{agent.port}/Mill"
    config.write_text(CONFIG.replace("URL", url) + AXES + SIGNALS, encoding="utf-8")
    command = [sys.executable, "-m", "abbe.daemon", "run", str(config), "--json"]
    run = subprocess.Popen(
        [*command, "--duration", "600"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
    )  # fmt: skip
    try:
        cycle = until(run, in_full)
        assert cycle["indicated"] == PLACE
        predicted = load_model(MODEL).axis_error(
            Conditions.at(PLACE, tool=TOOL, signals=cycle["temperatures"])
        )
        for axis in "XYZ":
            expected = 1e3 * float(predicted[axis][0])
            assert 1e3 * cycle["correction"][axis] == pytest.approx(expected, abs=0.5)
        # the adapter lost the machine
        agent.say(Xact="UNAVAILABLE")
        ended = until(run, lambda c: not c["guard"]["compensating"])
        assert "UNAVAILABLE" in ended["faults"]["axis X"]
        # held, then led to zero
        until(run, lambda c: not any(c["correction"].values()))
        agent.instance += 1
        agent.say(Xact=PLACE["X"])
        until(run, in_full)
    finally:
        run.terminate()
        _, errors = run.communicate(timeout=PATIENCE)
    assert run.returncode == 0, errors
    assert "Traceback" not in errors
    # units that are not those of the machine: refused in one line, by place
    agent.units["Yact"] = "INCH"
    refused = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    assert refused.returncode != 0
    assert "unit 'mm', but the agent states 'INCH' for Yact" in refused.stderr
    assert "Traceback" not in refused.stderr
