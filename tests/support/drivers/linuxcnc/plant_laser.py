"""A laser beside the mill: a serial read-out that sees where the tip really is.

``python -m tests.support.drivers.linuxcnc.plant_laser PLANT LINK``: PLANT is the file in which
`plant.py` leaves the tip's place, LINK the path of its serial line. It answers ``R`` with
``OK +00123.4567890``, mm from wherever it was set up, along the direction in which it was.
"""

from __future__ import annotations

import asyncio
import random
import sys
import time
from pathlib import Path
from typing import Any

from abbe.drivers.simulated.pseudo_terminals.pty_port import PtyPort
from abbe.drivers.simulated.remote_control import announce, serve_orders
from abbe.drivers.simulated.serial.devices import LineServer
from tests.support.drivers.linuxcnc.plant import RECORD

NOISE = 5e-5
"""mm, standard deviation of a reading."""


class PlantLaser:
    """The instrument (`AsciiDevice`).

    Parameters
    ----------
    plant
        The file in which the tip's place is.
    """

    def __init__(self, plant: Path) -> None:
        self._plant = plant
        self._random = random.Random(5)
        self._u = (1.0, 0.0, 0.0)
        self._zero: float | None = None
        self.broken = False

    def seen(self) -> tuple[list[float], list[float]]:
        """Where tip and motors are now, however busy the computer is, mm."""
        now = time.monotonic()
        while True:
            first, *values, last = RECORD.unpack(self._plant.read_bytes())
            if first == last and first >= now:
                return values[:3], values[3:]
            time.sleep(5e-4)

    def place(self, u: list[float]) -> None:
        """Set it up along a direction: it counts from here."""
        self._u = (u[0], u[1], u[2])
        self._zero = None

    def break_beam(self, broken: bool) -> None:
        """Break the beam, or let it pass again; the count is lost."""
        self.broken = broken
        self._zero = None

    def answer(self, query: str) -> str | None:
        """``R``: the reading; anything else ``?``."""
        return self.spontaneous() if query == "R" else "?"

    def spontaneous(self) -> str:
        """The reading as a line."""
        if self.broken:
            return "BEAM"
        along = sum(u * p for u, p in zip(self._u, self.seen()[0], strict=True))
        if self._zero is None:
            self._zero = along
        return f"OK {along - self._zero + self._random.gauss(0.0, NOISE):+015.7f}"


async def _serve(plant: Path, link: Path) -> None:
    laser = PlantLaser(plant)
    loop = asyncio.get_running_loop()
    lines = LineServer(laser, lambda data: port.send(data), loop.call_later)
    port = PtyPort(link, lines.receive)
    port.plug()
    announce(ready=True)

    def truth() -> dict[str, Any]:
        tip, motors = laser.seen()
        return {"tip": tip, "motors": motors}

    orders = {"place": laser.place, "beam": laser.break_beam, "truth": truth}
    try:
        await serve_orders(orders, die_with_stdin=True)
    finally:
        port.unplug()


if __name__ == "__main__":
    asyncio.run(_serve(Path(sys.argv[1]), Path(sys.argv[2])))
