"""Five-axis machines corrected live over a real Modbus socket, by a controller that closes a loop.

The controller drives the corrected positions of all five axes to a target, as one does that takes
them for its own. Where its axes then stand, a chain of rigid bodies that shares nothing with Abbe
says where the tool is.
"""

from __future__ import annotations

import asyncio
import math
import struct
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from abbe.compcore.files.model_file import save_model
from abbe.daemon.config import load_config
from abbe.daemon.guard import GuardState
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.service import Service
from abbe.daemon.status_word import Status
from abbe.drivers.simulated.bridge.device import Ranges, RefusedRequestError, WireFaults
from abbe.drivers.simulated.modbus.server import SimulatedServer
from abbe.drivers.simulated.registers import Table
from tests.support.compcore.five_axis import (
    CODES,
    TOOL,
    angle,
    chain,
    errors_of,
    machine_of,
    model_of,
)

pytestmark = pytest.mark.integration

MAX_TURN = 0.2
"""degrees"""
PATIENCE = 90.0


class FiveAxisController:
    """Serves a sample number and five positions; drives what is written back to the target.

    Input 0: sample (uint32), then float64 positions, rotary ones in degrees. Holding 0: Abbe's
    status word, 1 its heartbeat, 2 the echoed sample (uint32), then float64 corrected positions.
    """

    SIZE = 22
    ranges: ClassVar[Ranges] = {
        "coil": ((0, 16),),
        "discrete": ((0, 16),),
        "input": ((0, SIZE),),
        "holding": ((0, 2 + SIZE),),
    }

    def __init__(self, axes: Sequence[str], target: dict[str, float]) -> None:
        self.wire = WireFaults()
        self.axes = tuple(axes)
        self.target = target
        self.place = dict(target)
        self.closed = True
        self.refused: str = ""
        """Axis that cannot be read."""
        self.holding = [0] * (2 + self.SIZE)
        self.writes = 0
        self.off = math.inf
        """What is left to the target, mm and rad."""
        self._sample = 0
        self._latched: tuple[int, dict[str, float]] = (0, {})

    def read(self, table: Table, address: int, count: int, now: float) -> list[int]:
        if table == "holding":
            return self.holding[address : address + count]
        if self.refused:
            first = 2 + 4 * self.axes.index(self.refused)
            if address < first + 4 and first < address + count:
                raise RefusedRequestError(4)
        if address == 0:
            self._sample += 1
            self._latched = self._sample, dict(self.place)
        shown = [v if a in "XYZ" else math.degrees(v) for a, v in self.place.items()]
        words = struct.unpack(f">{self.SIZE}H", struct.pack(">I5d", self._sample, *shown))
        return list(words[address : address + count])

    def write(self, table: Table, address: int, values: Sequence[int], now: float) -> None:
        self.holding[address : address + len(values)] = values
        self.writes += 1
        if address == 0 and len(values) == len(self.holding):
            self._drive()

    @property
    def status(self) -> Status:
        return Status(self.holding[0])

    @property
    def corrected(self) -> dict[str, float]:
        _, *found = struct.unpack(">I5d", struct.pack(f">{self.SIZE}H", *self.holding[2:]))
        return {
            a: v if a in "XYZ" else math.radians(v) for a, v in zip(self.axes, found, strict=True)
        }

    def _drive(self) -> None:
        echo, *_ = struct.unpack(">I", struct.pack(">2H", *self.holding[2:4]))
        sample, where = self._latched
        if echo != sample or where != self.place or Status.COMPENSATING not in self.status:
            return
        left = {a: self.target[a] - v for a, v in self.corrected.items()}
        self.off = max(map(abs, left.values()))
        if self.closed:
            self.place = {a: v + left[a] for a, v in self.place.items()}


def config_text(axes: Sequence[str], port: int) -> str:
    def unit(a: str) -> str:
        return "mm" if a in "XYZ" else "deg"

    def channels(table: str, first: int, name: str, more: str = "") -> str:
        return "".join(
            f'{name}{a} = {{ table = "{table}", address = {first + 4 * i}, type = "float64", '
            f'unit = "{unit(a)}"{more} }}\n'
            for i, a in enumerate(axes)
        )

    return (
        f"""format = "abbe-config/1"
model = "model.toml"
[cycle]
period = 0.005
[guard]
max_correction = 0.2
max_rate = 5.0
max_turn = {MAX_TURN}
max_turn_rate = 5.0
stale_after = 5.0
hold = 0.2
ramp = 0.3
[tool]
offset = [{TOOL[0]}, {TOOL[1]}, {TOOL[2]}]
[links.nc]
driver = "modbus"
host = "127.0.0.1"
port = {port}
timeout = 4.0
separate = ["tables"]
[links.nc.channels]
sample = {{ table = "input", address = 0, type = "uint32" }}
abbe_status = {{ table = "holding", address = 0, type = "uint16", writable = true }}
abbe_heartbeat = {{ table = "holding", address = 1, type = "uint16", writable = true }}
echo = {{ table = "holding", address = 2, type = "uint32", writable = true }}
"""
        + channels("input", 2, "")
        + channels("holding", 4, "to_", ", writable = true")
        + "".join(f'[axes.{a}]\nsource = "nc.{a}"\n' for a in axes)
        + '[output]\nstatus = "nc.abbe_status"\nheartbeat = "nc.abbe_heartbeat"\n'
        + 'echo = [{ source = "nc.sample", target = "nc.echo" }]\n'
        + "".join(f'[output.axes.{a}]\ntarget = "nc.to_{a}"\n' for a in axes)
    )


class Live:
    """A service at work and its controller."""

    def __init__(self, controller: FiveAxisController, records: list[CycleRecord]) -> None:
        self.controller, self.records = controller, records

    async def until(self, what: Callable[[], object]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not what():
            assert time.monotonic() < deadline, self.records[-1:]
            await asyncio.sleep(0.005)


@asynccontextmanager
async def live(folder: Path, name: str, errors, target: dict[str, float]) -> AsyncIterator[Live]:
    machine = machine_of(CODES[name])
    save_model(model_of(machine, errors), folder / "model.toml")
    controller = FiveAxisController(machine.structure.axes, target)
    server = SimulatedServer(controller, 1)
    port = await server.start_tcp("127.0.0.1", 0)
    config = folder / "config.toml"
    config.write_text(config_text(machine.structure.axes, port), encoding="utf-8")
    service = Service(load_config(config))
    records: list[CycleRecord] = []
    service.add([records.append])
    running = asyncio.create_task(service.run())
    try:
        yield Live(controller, records)
    finally:
        service.stop()
        await asyncio.wait_for(running, PATIENCE)
        await server.stop()


def somewhere(name: str) -> dict[str, float]:
    axes = machine_of(CODES[name]).structure.axes
    place = {"X": 180.0, "Y": -60.0, "Z": -90.0, "A": 0.7, "B": -0.8, "C": 1.1}
    return {a: place[a] for a in axes}


@pytest.mark.parametrize("name", ["head-head", "table-table", "mixed"])
async def test_the_tool_comes_to_the_wanted_pose(tmp_path: Path, name: str) -> None:
    machine = machine_of(CODES[name])
    errors = errors_of(machine, seed=11)
    target = somewhere(name)
    wanted = chain(machine, None, target, TOOL)
    before = chain(machine, errors, target, TOOL)
    assert np.linalg.norm(before[0] - wanted[0]) > 1e-3
    assert angle(before[1], wanted[1]) > 1e-5
    async with live(tmp_path, name, errors, target) as run:
        nc = run.controller
        await run.until(lambda: nc.off < 1e-11)
        assert Status.ORIENTED in nc.status
        point, direction = chain(machine, errors, nc.place, TOOL)
        assert np.linalg.norm(point - wanted[0]) < 1e-6
        assert angle(direction, wanted[1]) < 1e-9
        last = run.records[-1]
        assert last.directions == ("X", "Y", "Z", *machine.structure.rotary)
        assert last.pose is not None
        assert last.pose.direction_left < 1e-9
    assert run.records[-1].decision.correction == (0.0,) * 5
    assert nc.status == 0
    # what was written last is what is indicated: nothing is corrected any more
    for a, v in nc.corrected.items():
        assert v == pytest.approx(run.records[-1].indicated[nc.axes.index(a)], abs=1e-12)


async def test_at_a_pole_the_point_is_reached_and_the_rest_is_reported(tmp_path: Path) -> None:
    machine = machine_of(CODES["head-head"])
    errors = errors_of(machine, seed=11)
    target = {**somewhere("head-head"), "B": 0.0}
    wanted = chain(machine, None, target, TOOL)
    async with live(tmp_path, "head-head", errors, target) as run:
        nc = run.controller
        await run.until(lambda: nc.off < 1e-11)
        assert Status.COMPENSATING in nc.status
        assert Status.ORIENTED not in nc.status
        point, direction = chain(machine, errors, nc.place, TOOL)
        pose = run.records[-1].pose
        assert np.linalg.norm(point - wanted[0]) < 1e-6
        assert pose is not None
        assert pose.damped
        assert pose.direction_left > 1e-6
        assert angle(direction, wanted[1]) == pytest.approx(pose.direction_left, abs=1e-9)
        turned = [abs(nc.place[a] - target[a]) for a in "BC"]
        assert max(turned) < math.radians(MAX_TURN)


async def test_a_lost_rotary_axis_holds_and_ramps_all_together(tmp_path: Path) -> None:
    machine = machine_of(CODES["mixed"])
    errors = errors_of(machine, seed=11)
    async with live(tmp_path, "mixed", errors, somewhere("mixed")) as run:
        nc = run.controller
        nc.closed = False
        await run.until(lambda: Status.ORIENTED in nc.status)
        full = run.records[-1].decision.correction
        assert min(map(abs, full[3:])) > 1e-6
        lost = len(run.records)
        nc.refused = "C"
        await run.until(lambda: run.records[-1].decision.states[0] is GuardState.OFF)
        story = run.records[lost:]
        assert any(r.decision.states == (GuardState.HOLDING,) * 5 for r in story)
        for record in story:
            assert len(set(record.decision.states)) == 1
            shares = [c / f for c, f in zip(record.decision.correction, full, strict=True)]
            assert shares == pytest.approx([shares[0]] * 5, abs=1e-6)
        gone = next(r for r in story if "axis C" in r.faults)
        assert math.isnan(gone.corrected[4])
        nc.refused = ""
        await run.until(lambda: Status.ORIENTED in nc.status)
