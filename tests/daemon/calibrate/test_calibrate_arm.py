"""``abbe calibrate`` of an arm, whose correction no axis X, Y or Z carries."""

from pathlib import Path

import pytest

from abbe.daemon.calibration.request import CalibrationRequest
from abbe.daemon.commands.calibration.guide import steps_now
from abbe.daemon.config import load_config
from tests.support.daemon.few_axes import ARM_CONFIG, write_machine

CALIBRATOR = """
[instrument.rotary-calibrator]
source = "robot.c"
reads = "error"
"""


@pytest.mark.parametrize(("machine", "live"), [("arm", False), ("SCARA", True)])
def test_nothing_is_written_for_abbe_run_that_it_would_refuse(
    tmp_path: Path, machine: str, live: bool
) -> None:
    write_machine(machine, tmp_path)
    text = ARM_CONFIG.replace("arm.toml", f"{machine}.toml")
    if machine == "SCARA":
        text = text.replace("[links.robot]", '[axes.Z]\nsource = "robot.z"\n[links.robot]')
        text = text.replace(r"(?P<c2>\S+)", r"(?P<c2>\S+) (?P<z>\S+)")
        text += 'z = { message = "all", unit = "mm" }\n'
    (tmp_path / "config.toml").write_text(text + CALIBRATOR, "utf-8")
    configuration = load_config(tmp_path / "config.toml")
    request = CalibrationRequest(
        configuration, tmp_path / "c", "1h", "1h", ("P=550,0,-50",), "", "", True
    )
    names = [now.step.name for now in steps_now(request)]
    assert names[:2] == ["start", "plan"]
    assert ("live" in names) is live
