"""What the workbench's page *Calibrate* is given of ``abbe calibrate``."""

from __future__ import annotations

from abbe.daemon.commands.calibration import step_child
from abbe.daemon.commands.calibration.guide import steps_now
from abbe.daemon.commands.calibration.request import CalibrationRequest
from abbe.daemon.commands.calibration.steps import CERTIFICATE, CHECK_PLAN, PLAN
from abbe.daemon.workbench.calibration.guide import CalibrationCommands


def calibration_commands() -> CalibrationCommands:
    """The command's request, steps and files."""
    plans = {"plan": PLAN, "check": CHECK_PLAN}
    return CalibrationCommands(
        CalibrationRequest, steps_now, plans, CERTIFICATE, step_child.__name__
    )
