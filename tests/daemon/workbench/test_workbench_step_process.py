"""A step of a calibration that is ended before it has begun: in an orderly way, in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from abbe.daemon.commands.calibration import step_child
from abbe.daemon.workbench.calibration.step_process import StepProcess

pytestmark = pytest.mark.integration


def test_a_step_that_is_stopped_at_once_says_so(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    task = {
        "step": "start", "config": str(tmp_path / "config.toml"), "folder": str(tmp_path / "c"),
        "time": "20min", "check_time": "10min", "tools": [], "controller": "", "tables": "",
        "by": "",
    }  # fmt: skip
    step = StepProcess(step_child.__name__, task)
    step.close()
    assert step.as_json()["lines"] == ["stopped; it goes on here"]
    assert step.as_json()["ended"] == "bad"
    assert capfd.readouterr().err == ""
