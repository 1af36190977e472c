"""Instruments that are no laser: an indicator on a serial line, an analogue input behind a second
Modbus device, a reference channel of the machine's own controller, all in one plan.
"""

from __future__ import annotations

import asyncio
import shutil
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Kind
from abbe.drivers.simulated.bridge.device import NotWritableError, Ranges, WireFaults
from abbe.drivers.simulated.modbus.server import SimulatedServer
from abbe.drivers.simulated.pseudo_terminals.pty_port import PtyPort
from abbe.drivers.simulated.registers import Table
from tests.integration.test_measure import NOISE_UM, campaign_of, off_the_truth
from tests.support.daemon.live_run import MODEL
from tests.support.daemon.measuring import (
    QUICK,
    Driver,
    bench,
    configuration,
    line_plan,
    measuring,
    rms,
    write_plan,
)

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

OFFSET, PER_VOLT = 10000, 20.0
"""Of the analogue module: counts at 0 V; µm for a volt, of 1000 counts."""
DIALS = [0.0, 1.5, -2.25, 4.0]
"""µm: what the dial shows at its targets."""
PROBE = [3.0, -1.2, 0.4]
"""µm: what the inductive probe shows at its targets."""
INSTRUMENTS = """
[links.dial]
driver = "serial"
port = "{dial}"
timeout = 2.0
query_terminator = "\\r"
[links.dial.messages.value]
query = "?"
pattern = '(?P<dial>[-+]?[\\d.]+) *mm'
[links.dial.channels]
dial = {{ message = "value", unit = "mm" }}

[links.module]
driver = "modbus"
transport = "tcp"
host = "127.0.0.1"
port = {module}
unit_id = 7
timeout = 2.0
[links.module.channels.probe]
table = "input"
address = 3
type = "uint16"
scale = 0.02
offset = -200.0
unit = "um"

[instrument.laser]
source = "cmm.true_X"
reads = "length"
stale_after = 2.0
[instrument.indicator]
source = "dial.dial"
reads = "error"
sign = -1
stale_after = 2.0
[instrument.straightness]
source = "module.probe"
reads = "error"
stale_after = 2.0
"""


class AnalogueModule:
    """A module with one analogue input, in an input register: 10000 counts at 0 V, 1000 a volt."""

    def __init__(self) -> None:
        self.wire = WireFaults()
        self.volts = 0.0

    @property
    def ranges(self) -> Ranges:
        return {"coil": ((0, 1),), "discrete": ((0, 1),), "holding": ((0, 1),), "input": ((0, 4),)}

    def read(self, table: Table, address: int, count: int, _: float) -> list[int]:
        assert table == "input"
        words = [0, 0, 0, OFFSET + round(1000.0 * self.volts)]
        return words[address : address + count]

    def write(self, table: Table, address: int, values: Sequence[int], now: float) -> None:
        raise NotWritableError


class Bench:
    """The two devices, in a thread of their own."""

    def __init__(self, folder: Path) -> None:
        self.module, self.dial, self.link, self.port = AnalogueModule(), 0.0, folder / "dial", 0
        self._folder = folder

    @contextmanager
    def served(self) -> Iterator[None]:
        ready, stop = threading.Event(), asyncio.Event()
        loops: list[asyncio.AbstractEventLoop] = []

        async def serve() -> None:
            server = SimulatedServer(self.module, 7)
            line = PtyPort(
                self.link, lambda _: line.send(f"{self.dial * 1e-3:+.5f}mm\r\n".encode())
            )
            line.plug()
            self.port = await server.start_tcp("127.0.0.1", 0)
            loops.append(asyncio.get_running_loop())
            ready.set()
            await stop.wait()
            line.unplug()
            await server.stop()

        thread = threading.Thread(target=lambda: asyncio.run(serve()), daemon=True)
        thread.start()
        assert ready.wait(30.0)
        try:
            yield
        finally:
            loops[0].call_soon_threadsafe(stop.set)
            thread.join(10.0)


def test_a_dial_an_analogue_input_and_a_reference_channel(tmp_path: Path) -> None:
    """Each row is what that instrument showed there, or the exact machine; nothing is mixed up."""
    shutil.copy(MODEL, tmp_path / "model.toml")
    write_plan(
        tmp_path / "plan.toml",
        line_plan("x_line", "X", [100, 200, 300]),
        line_plan("dial", "Y", [100, 200, 300, 400], instrument="indicator", both_ways=False,
                  u=(0.0, 0.0, 1.0), free='["zero", "slope"]'),
        line_plan("probe", "Z", [-300, -200, -100], instrument="straightness", both_ways=False,
                  u=(1.0, 0.0, 0.0), free='["zero", "slope"]'),
    )  # fmt: skip
    others = Bench(tmp_path)
    with others.served(), bench() as process:
        text = configuration(process.ready, tmp_path).read_text("utf-8")
        made = text[: text.index("[links.laser]")] + QUICK
        made += INSTRUMENTS.format(dial=others.link, module=others.port)
        (tmp_path / "config.toml").write_text(made, encoding="utf-8")
        out = tmp_path / "campaign.csv"
        with measuring(tmp_path / "plan.toml", tmp_path / "config.toml", out) as run:
            run.until(lambda e: e["event"] == "next")
            machine = Driver(process, run, tmp_path / "plan.toml", tmp_path / "model.toml")
            machine.read(*range(6))
            at = 6
            for shown in (*DIALS, DIALS[0]):  # the first again: the master point
                others.dial = shown
                machine.read(at)
                at += 1
            for micrometres in (*PROBE, PROBE[0]):
                others.module.volts = micrometres / PER_VOLT
                machine.read(at)
                at += 1
            assert run.wait() == 0, run.said
        found = campaign_of(tmp_path)
        c = found.conditions
        assert c.setup is not None
        x_line = found.rows(c.setup == "x_line")
        assert rms(off_the_truth(process, x_line)) < NOISE_UM
    assert (found.kind == Kind.DISPLACEMENT).all()
    dial, probe = (1e3 * found.value[c.setup == name] for name in ("dial", "probe"))
    assert dial == pytest.approx(-np.array([*DIALS, DIALS[0]]), abs=1e-3)  # sign = -1
    assert probe == pytest.approx([*PROBE, PROBE[0]], abs=0.5 * PER_VOLT / 1000.0 + 1e-6)
