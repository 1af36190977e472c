"""A table made by Abbe, run by a real LinuxCNC: sign, interpolation, both directions, other rows.

The machine's errors are functions written here; the model knows them only as samples. LinuxCNC is
moved to points between the table's rows, upwards and downwards, and where its motors would then
have brought a machine with these errors is compared with where it was told to go.
"""

from __future__ import annotations

import asyncio
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from abbe.compcore.effects import Backlash, Positioning
from abbe.compcore.files.model_file import save_model
from abbe.compcore.machine.machine import Axis
from abbe.compcore.machine.machine import Machine as Described
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from abbe.daemon.cli import main
from tests.support.drivers.linuxcnc.machine import Machine

pytestmark = pytest.mark.integration

TRAVEL = (-300.0, 300.0)
BACKLASH = {"X": -0.012, "Y": 0.006, "Z": -0.020}
"""mm: mean arrival upwards minus mean arrival downwards."""


def error(axis: str, q: float, upward: bool) -> float:
    """Where the machine really stands minus where its motor is, mm."""
    curve = {
        "X": 0.030 * np.sin(q / 70.0) + 5e-5 * q,
        "Y": 0.015 * np.cos(q / 45.0) - 2e-7 * q * q,
        "Z": -0.025 * np.tanh(q / 40.0),
    }[axis]
    return float(curve + 0.5 * BACKLASH[axis] * (1.0 if upward else -1.0))


def save_the_model(path: Path) -> None:
    structure = Structure.parse("w b X Y Z t")
    owner = Described("mill", structure, {a: Axis(a, TRAVEL) for a in "XYZ"})
    positions = np.linspace(*TRAVEL, 121)
    terms = []
    for axis in "XYZ":
        effect = Positioning(axis=axis, shape="table", positions=tuple(positions.tolist()))
        middle = [0.5 * (error(axis, q, True) + error(axis, q, False)) for q in positions]
        values = {f"v{i}": Value(v) for i, v in enumerate(middle, start=1)}
        terms += [Term(effect, values), Term(Backlash(axis=axis), {"b": Value(BACKLASH[axis])})]
    save_model(Model(owner, tuple(terms)), path)


class Compensated(Machine):
    """LinuxCNC with compensation files."""

    def __init__(self, tables: Path, kind: str) -> None:
        self._tables = tables
        super().__init__(
            {
                f"[JOINT_{i}]": f"[JOINT_{i}]\nCOMP_FILE = {a}.comp\nCOMP_FILE_TYPE = {kind}"
                for i, a in enumerate("xyz")
            }
        )

    def start(self) -> None:
        for file in self._tables.glob("*.comp"):
            (self.folder / file.name).write_bytes(file.read_bytes())
        super().start()


@pytest.fixture(scope="module", params=["0", "1"])
def running(request: Any, tmp_path_factory: Any) -> Iterator[tuple[Compensated, Path]]:
    folder = tmp_path_factory.mktemp("mill")
    save_the_model(folder / "model.toml")
    order = ["abbe", "table", str(folder / "model.toml"), "--controller", "linuxcnc",
             "-o", str(folder / "t"), "--set", f"type={request.param}"]  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", order)
        with pytest.raises(SystemExit, match="0"):
            main()
    with Compensated(folder / "t", request.param) as machine:
        machine.order("on")
        machine.order("home")
        yield machine, folder / "t"


def pins(joint: int) -> tuple[float, float]:
    """Position that is wanted of a joint, and where its motor is sent, mm."""
    found = []
    for pin in ("pos-cmd", "motor-pos-cmd", "motor-offset"):
        done = subprocess.run(
            ["halcmd", "getp", f"joint.{joint}.{pin}"], capture_output=True, text=True, check=True
        )
        found.append(float(done.stdout))
    return found[0], found[1] - found[2]


PATH = [-250.0, -171.3, -33.3, 0.0, 48.7, 211.1, 287.9, 230.6, 101.4, 7.7, -66.6, -199.9, -120.0]


async def test_linuxcnc_stands_where_it_was_sent(running: tuple[Compensated, Path]) -> None:
    machine, tables = running
    rows = {a: np.loadtxt(tables / f"{a.lower()}.comp")[:, 0] for a in "XYZ"}
    answer = await asyncio.to_thread(machine.order, "mdi", "G21 G90 G1 F9000 X-260 Y-260 Z-260")
    assert answer == []
    before = -260.0
    off, raw = [], []
    for wanted in PATH:
        words = f"G1 X{wanted} Y{wanted} Z{wanted}"
        assert await asyncio.to_thread(machine.order, "mdi", words) == []
        await asyncio.sleep(0.1)
        for joint, axis in enumerate("XYZ"):
            assert np.abs(rows[axis] - wanted).min() > 1e-3 or wanted == 0.0
            at, motor = pins(joint)
            assert at == pytest.approx(wanted, abs=1e-6)
            upward = wanted > before
            off.append(motor + error(axis, motor, upward) - wanted)
            raw.append(error(axis, wanted, upward))
        before = wanted
    # 0.1 µm of interpolation by the table, 0.2 µm by the model's own samples
    assert np.abs(off).max() < 0.35e-3
    assert np.abs(raw).max() > 25e-3
