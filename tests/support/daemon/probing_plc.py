"""A controller on a real Modbus socket that measures check points, and a run that corrects it."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path

from abbe.daemon.config import load_config
from abbe.daemon.service import Service
from tests.support.daemon.live_run import PATIENCE
from tests.support.drivers.modbus_devices import Memory, TcpDevice

POINTS_AT = 100
"""First input register of the check points; each has eight: trigger, spare, three float32."""

_HEAD = """format = "abbe-config/1"
model = "{model}"
[cycle]
period = 0.02
signals_every = 0.1
[guard]
max_correction = 0.1
max_rate = 1.0
stale_after = 5.0
signals_stale_after = 60.0
hold = 0.2
ramp = 0.2
[journal]
file = "journal.log"
[records]
every = 0.1
[checks]
look_every = 0.05
[output]
status = "plc.status"
heartbeat = "plc.heartbeat"
[links.plc]
driver = "modbus"
transport = "tcp"
host = "127.0.0.1"
port = {port}
unit_id = 1
timeout = 3.0
separate = ["tables"]
[links.plc.channels]
status = {{ table = "holding", address = 0, type = "uint16", writable = true }}
heartbeat = {{ table = "holding", address = 1, type = "uint16", writable = true }}
"""


class ProbingPlc(Memory):
    """Axes and signals as float32 from input register 0 on, in order; check points from 100 on."""

    def __init__(self, stands: Mapping[str, float], points: tuple[str, ...]) -> None:
        super().__init__()
        self.names, self.points = list(stands), list(points)
        self.words[1, "input"] = [0] * self.size
        self.words[1, "holding"] = [0] * self.size
        for name, value in stands.items():
            self.stand(name, value)

    def _put(self, at: int, *values: float) -> None:
        for k, value in enumerate(values):
            words = struct.unpack(">HH", struct.pack(">f", value))
            self.words[1, "input"][at + 2 * k : at + 2 * k + 2] = words

    def stand(self, name: str, value: float) -> None:
        """An axis stands, or a signal is, so."""
        self._put(2 * self.names.index(name), value)

    def measured(self, point: str, *values: float, trigger: int | None = None) -> None:
        """The controller has measured a check point: values first, then the trigger."""
        at = POINTS_AT + 8 * self.points.index(point)
        self._put(at + 2, *values)
        words = self.words[1, "input"]
        words[at] = words[at] + 1 if trigger is None else trigger

    def config(self, model: Path, sections: str, port: int, axes: str = "XYZ") -> str:
        """The text of a configuration; `sections`: of the check points, and what a test adds."""
        lines = [_HEAD.format(model=model, port=port)]
        channel = '{{ table = "input", address = {at}, type = "float32", unit = "{unit}" }}'
        for k, name in enumerate(self.names):
            unit = "mm" if name in axes else "degC"
            lines.append(f"{name} = {channel.format(at=2 * k, unit=unit)}")
        for k, point in enumerate(self.points):
            at = POINTS_AT + 8 * k
            lines.append(f'{point}_n = {{ table = "input", address = {at}, type = "uint16" }}')
            for i, axis in enumerate("XYZ"):
                place = at + 2 + 2 * i
                lines.append(f"{point}_{axis} = {channel.format(at=place, unit='mm')}")
            um = channel.format(at=at + 2, unit="um")
            lines.append(f"{point}_um = {um}")
        for name in self.names:
            section = "axes" if name in axes else "signals"
            rate = "" if name in axes else "\nmax_rate = 1e6"
            lines.append(f'[{section}.{name}]\nsource = "plc.{name}"{rate}')
        return "\n".join([*lines, sections]) + "\n"


def sphere(name: str, more: str = "") -> str:
    """The section of a sphere's check point."""
    found = ", ".join(f'"plc.{name}_{axis}"' for axis in "XYZ")
    return f'[checks.points.{name}]\ntrigger = "plc.{name}_n"\nfound = [{found}]\n{more}\n'


@asynccontextmanager
async def probing(
    plc: ProbingPlc, model: Path, sections: str, folder: Path
) -> AsyncIterator[tuple[Service, TcpDevice]]:
    """A run over a real socket; ended as Ctrl-C does."""
    async with TcpDevice(plc) as device:
        config = folder / "config.toml"
        config.write_text(plc.config(model, sections, device.port), "utf-8")
        service = Service(load_config(config))
        task = asyncio.create_task(service.run())
        try:
            yield service, device
        finally:
            service.stop()
            await asyncio.wait_for(task, PATIENCE)


async def until(what: Callable[[], object]) -> None:
    """Wait for a state."""
    async with asyncio.timeout(PATIENCE):
        while not what():  # noqa: ASYNC110
            await asyncio.sleep(5e-3)


def looked_at(service: Service) -> bool:
    """Whether cycles go round and every trigger was seen once."""
    seen = all(t._known is not None for t in service.checks._triggers)
    return seen and service.logbook.cycles.latest is not None
