"""``abbe run --json`` with positions and temperatures of an OPC UA server that is not Abbe's."""

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
from tests.support.drivers.opcua.mill import URI, Mill

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
driver = "opcua"
url = "URL"
timeout = 2.0
[links.mill.channels]
x = {{ node = "nsu={URI};s=Mill/x", unit = "mm" }}
y = {{ node = "nsu={URI};s=Mill/y", unit = "mm" }}
z = {{ node = "nsu={URI};s=Mill/z", unit = "mm" }}
T = {{ node = "nsu={URI};s=Mill/T", unit = "degC", every = 0.2 }}
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


def test_positions_that_are_bad_or_old_end_the_correction(server: Mill, tmp_path: Path) -> None:
    server.say(**{axis.lower(): {"value": at} for axis, at in PLACE.items()})
    server.say(T={"value": 22.5})
    config = tmp_path / "config.toml"
    config.write_text(CONFIG.replace("URL", server.url) + AXES + SIGNALS, encoding="utf-8")
    run = subprocess.Popen(
        [sys.executable, "-m", "abbe.daemon", "run", str(config), "--json", "--duration", "600"],
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
        # the server goes on answering, with what it has not measured
        server.say(x={"value": 350.0, "status": "UncertainLastUsableValue"})
        ended = until(run, lambda c: not c["guard"]["compensating"])
        assert "UncertainLastUsableValue" in ended["faults"]["axis X"]
        # held, then led to zero
        until(run, lambda c: not any(c["correction"].values()))
        server.say(x={"value": 350.0})
        until(run, in_full)
        # nor does it help that the status is good, where the source has stopped
        server.say(x={"value": 350.0, "source_age": 30.0})
        until(run, lambda c: not c["guard"]["compensating"])
        server.say(x={"value": 350.0})
        until(run, in_full)
    finally:
        run.terminate()
        _, errors = run.communicate(timeout=PATIENCE)
    assert run.returncode == 0, errors
    assert "Traceback" not in errors
