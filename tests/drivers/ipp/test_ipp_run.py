"""``abbe check`` and ``abbe run --json`` with positions by I++ DME and without output."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from abbe.compcore.files.model_file import load_model
from abbe.compcore.machine.conditions import Conditions
from abbe.drivers.simulated.bridge.machine import TOOL
from abbe.drivers.simulated.process import SimulatedProcess

pytestmark = pytest.mark.integration

MODEL = Path(__file__).parents[3] / "examples" / "bridge-cmm" / "model.toml"
PATIENCE = 90.0

CONFIG = """\
format = "abbe-config/1"
model = "{model}"
[cycle]
period = 0.05
[guard]
max_correction = 0.1
max_rate = 0.5
stale_after = 3.0
signals_stale_after = 20.0
[tool]
sources = ["cmm.tool_x", "cmm.tool_y", "cmm.tool_z"]
[links.cmm]
driver = "ipp"
host = "127.0.0.1"
port = {port}
timeout = 10.0
{report}
[links.cmm.channels]
x = {{ axis = "X" }}
y = {{ axis = "Y" }}
z = {{ axis = "Z", offset = 150.0 }}
tool_x = {{ property = "Tool.AvrOffsets", unit = "mm", item = 1 }}
tool_y = {{ property = "Tool.AvrOffsets", unit = "mm", item = 2 }}
tool_z = {{ property = "Tool.AvrOffsets", unit = "mm", item = 3 }}
T_x = {{ scale_temperature = "X" }}
T_y = {{ scale_temperature = "Y" }}
T_z = {{ scale_temperature = "Z" }}
"""
AXES = "".join(f'[axes.{axis}]\nsource = "cmm.{axis.lower()}"\n' for axis in "XYZ")
SIGNALS = "".join(
    f'[signals.T_{axis}{n}]\nsource = "cmm.T_{axis}"\n' for axis in "xyz" for n in (1, 2)
)
REPORT = "move_report = { time = 0.1, distance = 0.05, within = 10.0 }"


def abbe(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "abbe.daemon", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
    )


@pytest.mark.one_in(2)
@pytest.mark.parametrize("report", ["", REPORT], ids=["asked", "reported"])
def test_the_correction_at_positions_and_temperatures_of_the_server(
    tmp_path: Path, report: str
) -> None:
    model = load_model(MODEL)
    with SimulatedProcess("ipp") as cmm:
        config = tmp_path / "config.toml"
        text = CONFIG.format(model=MODEL, port=cmm.ready["port"], report=report)
        config.write_text(text + AXES + SIGNALS, encoding="utf-8")
        run = abbe("run", str(config), "--json", "--duration", "600")
        assert run.stdout is not None
        seen: list[dict[str, Any]] = []
        deadline = time.monotonic() + PATIENCE
        try:
            for line in run.stdout:
                cycle = json.loads(line)
                if cycle["guard"]["compensating"] and not cycle["guard"]["rate_limited"]:
                    seen.append(cycle)
                # a busy server stands still meanwhile: until it was seen to move
                if len(seen) >= 20 and len({c["indicated"]["Y"] for c in seen}) > 5:
                    break
                assert time.monotonic() < deadline, line
        finally:
            run.terminate()
            _, errors = run.communicate(timeout=PATIENCE)
        assert run.returncode == 0, errors
        assert len(seen) >= 20, errors
        commands = cmm.order("report")["commands"]
    assert commands[-1] == "EndSession()"
    for cycle in seen:
        indicated = {axis: float(cycle["indicated"][axis]) for axis in "XYZ"}
        predicted = model.axis_error(
            Conditions.at(indicated, tool=TOOL, signals=cycle["temperatures"])
        )
        for axis in "XYZ":
            # the guard holds the rate, and folding costs 10 nm
            expected = 1e3 * float(predicted[axis][0])
            assert 1e3 * cycle["correction"][axis] == pytest.approx(expected, abs=0.5)
        assert cycle["links"]["cmm"]["state"] == "up"
        assert not cycle["faults"]
        assert not cycle["written"]
    assert len({cycle["indicated"]["Y"] for cycle in seen}) > 5


def test_what_is_linked_is_reported(tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    text = CONFIG.format(model=MODEL, port=1294, report="")
    config.write_text(text + AXES + SIGNALS, encoding="utf-8")
    checked = abbe("check", str(config))
    out, errors = checked.communicate(timeout=PATIENCE)
    assert checked.returncode == 0, errors
    for what in ("X by Get, in MachineCsy", "temperature of the X scale", "Tool.AvrOffsets"):
        assert what in " ".join(out.split())
    config.write_text(
        text + AXES + SIGNALS + '[output.axes.X]\ntarget = "cmm.x"\n', encoding="utf-8"
    )
    checked = abbe("check", str(config))
    _, errors = checked.communicate(timeout=PATIENCE)
    assert checked.returncode == 1
    assert "cmm.x cannot be written" in errors
