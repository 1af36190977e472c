"""A program of moves, run by the simulated bridge: straight moves, stops, an instrument placed."""

from __future__ import annotations

import asyncio
import math
import time
from typing import Any

from abbe.drivers.simulated.bridge.laser import Optics, SimulatedLaser
from abbe.drivers.simulated.bridge.plant import Plant

_LOOK = 0.005
_THERE = 1.01e-4
"""mm: a count."""


class ProgramRunner:
    """Drives a plant from place to place.

    Attributes
    ----------
    plant
        The machine.
    """

    def __init__(self, plant: Plant, laser: SimulatedLaser) -> None:
        self.plant = plant
        self._laser = laser
        self._done = 0
        self._moves: list[dict[str, Any]] = []
        self._task: asyncio.Task[None] | None = None

    def drive(self, moves: list[dict[str, Any]], speed: float = 0.0) -> None:
        """Run a program from now on; one that runs is ended.

        Parameters
        ----------
        moves
            Each ``{"to": [x, y, z], "stands": s}`` (mm, s), or ``{"place": {…}}``, which sets the
            instrument up.
        speed
            Of all moves, mm/s; 0: as the machine has it.
        """
        self.stop()
        if speed:
            self.plant.speed = speed
        self._moves, self._done = moves, 0
        self._task = asyncio.ensure_future(self._run())

    def where(self) -> dict[str, Any]:
        """How far the program is, and where the machine indicates to stand."""
        latch = self.plant.latch(time.monotonic())
        return {
            "at_move": self._done,
            "of": len(self._moves),
            "at": list(latch.position),
            "temperatures": latch.temperatures.tolist(),
        }

    def stop(self) -> None:
        """End the program; the machine stands where it is sent to."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def _run(self) -> None:
        for move in self._moves:
            if "place" in move:
                self._laser.place(Optics(**move["place"]))
            else:
                await self._go(move["to"])
                await asyncio.sleep(move.get("stands", 0.0))
            self._done += 1

    async def _go(self, to: list[float]) -> None:
        wrong = self.plant.disturbances
        wrong.target, wrong.go_to = (to[0], to[1], to[2]), True
        while not self._there(to):  # noqa: ASYNC110  (nothing says that a place is reached)
            await asyncio.sleep(_LOOK)

    def _there(self, to: list[float]) -> bool:
        return math.dist(self.plant.latch(time.monotonic()).position, to) <= _THERE
