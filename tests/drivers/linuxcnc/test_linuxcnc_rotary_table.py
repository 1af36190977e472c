"""A rotary table's own compensation file, run by a real LinuxCNC on an angular joint."""

from __future__ import annotations

import asyncio
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.effects import RotaryPositioning
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from abbe.compcore.tables.of_model import project_tables
from abbe.drivers.controllers import make_controller
from tests.drivers.linuxcnc.test_linuxcnc_table import Compensated, pins

pytestmark = [pytest.mark.integration, pytest.mark.thorough]

ANGULAR = {
    "COORDINATES = X Y Z": "COORDINATES = X Y C",
    "KINEMATICS = trivkins": "KINEMATICS = trivkins coordinates=XYC",
    "[AXIS_Z]": "[AXIS_C]",
    "[JOINT_2]\nTYPE = LINEAR": "[JOINT_2]\nCOMP_FILE = c.comp\nCOMP_FILE_TYPE = 0\nTYPE = ANGULAR",
}


class Turning(Compensated):
    """The mill, its Z a rotary table C."""

    def __init__(self, tables: Path) -> None:
        super().__init__(tables, "0")
        self._changes = ANGULAR


def stands(motor: float) -> float:
    """Where the table stands whose encoder says `motor`, degrees."""
    turn = np.radians(motor)
    return float(motor + np.degrees(3e-4 * np.cos(turn) - 2e-4 * np.sin(turn)))


async def test_the_table_stands_where_it_was_sent(tmp_path: Path) -> None:
    machine = Machine("table", Structure.parse("w C' b t"), {"C": Axis("C", (-np.pi, np.pi))})
    values = {"A1": Value(3e-4), "B1": Value(-2e-4), "A2": Value(0.0), "B2": Value(0.0)}
    model = Model(machine, (Term(RotaryPositioning(axis="C"), values),))
    controller = make_controller("linuxcnc", machine, {})
    files = controller.write(project_tables(model, controller.capability).tables)
    (tmp_path / "c.comp").write_text(files["c.comp"])
    off, raw = [], []
    with Turning(tmp_path) as turning:
        turning.order("on")
        turning.order("home")
        for wanted in (-150.0, -61.7, 13.3, 88.8, 171.1, 100.1, -3.3):
            words = f"G21 G90 G1 F9000 C{wanted}"
            assert await asyncio.to_thread(turning.order, "mdi", words) == []
            await asyncio.sleep(0.1)
            at, motor = pins(2)
            assert at == pytest.approx(wanted, abs=1e-6)
            off.append(stands(motor) - wanted)
            raw.append(stands(wanted) - wanted)
    # a tolerance of 0.1 µm at 100 mm is 1 µrad
    assert np.degrees(1.3e-6) > np.abs(off).max()
    assert np.abs(raw).max() > np.degrees(2e-4)
