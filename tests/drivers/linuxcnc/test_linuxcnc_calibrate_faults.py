"""``abbe calibrate`` on a real LinuxCNC, faults half-way: each is said, and it goes on there."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from tests.drivers.linuxcnc.test_linuxcnc_calibrate import WORDS, write_configuration, write_model
from tests.support.drivers.linuxcnc.calibrating import CalibrateRun, ProgramRun, calibrating
from tests.support.drivers.linuxcnc.measured_mill import MeasuredMill

pytestmark = [pytest.mark.integration, pytest.mark.calibration, pytest.mark.timeout(600)]


def bridges(run: CalibrateRun) -> list[int]:
    """The processes by which a calibration speaks to LinuxCNC: its own children, no others."""
    pid = run.process.pid
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text("ascii").split()
    return [
        int(child) for child in children if b"bridge" in Path(f"/proc/{child}/cmdline").read_bytes()
    ]


def rows_of(campaign: bytes) -> list[bytes]:
    """The lines of a campaign below its head, which names every new zero's set-up."""
    return [line for line in campaign.splitlines() if not line.startswith(b"#")]


def test_operators_stop_killed_bridge_linuxcnc_switched_off_and_on_again() -> None:
    with MeasuredMill() as mill, mill.place_laser():
        folder, made = mill.folder, mill.folder / "calibration"
        write_configuration(mill)
        write_model(folder / "model.toml")
        mill.ready()
        words = (*WORDS, "--upto", "measure")
        first = (made / "program.nc", made / "plan.toml", made / "campaign.csv")
        with calibrating(folder, *words) as run:
            run.until("set up 01_")
            program = ProgramRun(mill, *first)
            program.drive(run, 3)  # the operator's stop
            (bridge,) = bridges(run)
            os.kill(bridge, signal.SIGKILL)
            run.until("no position")
            run.until("positions are read again")
            program.drive(run, 5)  # begun anew: it passes what was read
            assert run.end() != 0
            assert "measure is not done; the steps before it are" in run.said
        kept = first[2].read_bytes()
        mill.end()
        with calibrating(folder, *words) as run:
            run.until("no position: ")  # LinuxCNC is waited for, and that is said
            assert "plan: which measurements: done" in run.said
            assert run.end() != 0
        assert first[2].read_bytes() == kept
        mill.start()
        mill.ready()
        with calibrating(folder, *words) as run:
            run.until(f"goes on: {program.rows()} of")
            run.until("set up again 01_")
            program.drive(run, program.rows() + 2)
            mill.order("off")
            run.until("no position")
            assert run.end() != 0
        rows = rows_of(first[2].read_bytes())
        assert rows[: len(rows_of(kept))] == rows_of(kept)
        assert len(rows) > len(rows_of(kept))
