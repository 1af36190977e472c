"""A live run of ``abbe run --json`` that only reads a machine: its configuration, its cycles."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from abbe.compcore.files.model_file import load_model
from abbe.compcore.machine.conditions import Conditions

MODEL = Path(__file__).parents[3] / "examples" / "bridge-cmm" / "model.toml"
PATIENCE = 90.0
PLACE = {"X": 350.0, "Y": 450.0, "Z": -180.0}
TOOL = (0.0, 0.0, -150.0)

_HEAD = f"""\
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
"""
_AXES = "".join(f'[axes.{axis}]\nsource = "mill.{axis.lower()}"\n' for axis in "XYZ")
_SIGNALS = "".join(f'[signals.T_{a}{n}]\nsource = "mill.T"\n' for a in "xyz" for n in (1, 2))


def configuration(link: str) -> str:
    """Axes X, Y, Z and all signals from the channels x, y, z, T of the link ``mill``."""
    return _HEAD + link + _AXES + _SIGNALS


def command(config: Path) -> list[str]:
    """``abbe run CONFIG --json``."""
    return [sys.executable, "-m", "abbe.daemon", "run", str(config), "--json"]


@contextmanager
def running(config: Path) -> Iterator[subprocess.Popen[str]]:
    """The run; at the end it was ended in order, and said no traceback."""
    run = subprocess.Popen(
        [*command(config), "--duration", "600"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
    )  # fmt: skip
    try:
        yield run
    finally:
        run.terminate()
        _, errors = run.communicate(timeout=PATIENCE)
    assert run.returncode == 0, errors
    assert "Traceback" not in errors


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
    """Whether it corrects as far as it would."""
    guard = cycle["guard"]
    return bool(guard["compensating"] and not guard["rate_limited"])


def assert_corrected_as_foretold(cycle: dict[str, Any]) -> None:
    """The indicated positions are `PLACE`, and the correction is the model's error there."""
    assert cycle["indicated"] == PLACE
    predicted = load_model(MODEL).axis_error(
        Conditions.at(PLACE, tool=TOOL, signals=cycle["temperatures"])
    )
    for axis in "XYZ":
        expected = 1e3 * float(predicted[axis][0])
        assert 1e3 * cycle["correction"][axis] == pytest.approx(expected, abs=0.5)
