"""The simulated bridge under its I++ server's orders: moves, touches, collisions.

``GoTo`` and ``PtMeas`` as the standard describes them (I++ DME 1.5, 6.12): the nominal point lies
on the surface; approach position and end of search are counted from it along ``IJK``; reported is
the middle of the tip at contact. Whatever the stylus touches on a way that is no search is a
collision.
"""

from __future__ import annotations

import asyncio
import math
import random
import time

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.machine import AXES, PLACES, TRAVELS
from abbe.drivers.simulated.bridge.plant import Plant
from abbe.drivers.simulated.ipp.gauge import SimulatedGauge
from abbe.drivers.simulated.ipp.rotary_table import SimulatedTable
from abbe.drivers.simulated.ipp.wire import IppCommandError, named_arguments
from abbe.drivers.simulated.ipp.workpiece import SimulatedPlate, first_contact, nearest

Array = NDArray[np.float64]

_NEAR = 2e-3
"""mm from a place within which the machine has come to it."""
_ROUNDS = 2
_SHAFT_STEP = 2.0
"""mm between two looks at where the shaft is."""
_SHAFT = 60.0
"""mm of the shaft that are looked at beside a gauge."""


class ProbeCarrier:
    """The machine that carries a stylus.

    Parameters
    ----------
    plant
        The running machine.
    hurry
        How many times faster than it is told it moves.
    tip, shaft
        Radius of the stylus's ball and of its shaft, mm.

    Attributes
    ----------
    plates
        What lies there; on the rotary table where there is one.
    gauge
        A gauge beside it; None: there is none.
    table
        The rotary table; None: there is none.
    nearest_way
        Least distance of the tip's middle from any ball's middle on ways, less the sum of their
        radii, mm.
    """

    def __init__(
        self, plant: Plant, hurry: float = 1.0, tip: float = 2.0, shaft: float = 1.25
    ) -> None:
        self._plant = plant
        self._hurry = hurry
        self._tip, self._shaft = tip, shaft
        self._random = random.Random(f"touch {plant.seed}")
        self.plates: list[SimulatedPlate] = []
        self.gauge: SimulatedGauge | None = None
        self.table: SimulatedTable | None = None
        self.nearest_way = math.inf
        self._properties = {
            "Tool.GoToPar.Speed": 100.0,
            "Tool.PtMeasPar.Speed": 5.0,
            "Tool.PtMeasPar.Approach": 5.0,
            "Tool.PtMeasPar.Search": 5.0,
            "Tool.PtMeasPar.Retract": -1.0,
        }

    def set_property(self, name: str, value: str) -> None:
        """Set a property.

        Raises
        ------
        IppCommandError
            When there is none, or it is no number.
        """
        if name not in self._properties:
            raise IppCommandError(3, 510, "Bad property")
        try:
            self._properties[name] = float(value)
        except ValueError:
            raise IppCommandError(3, 509, "Bad argument") from None

    def halt(self) -> None:
        """Stop where it is."""
        plant = self._plant
        plant.disturbances.target = plant.latch(time.monotonic()).position

    def lift(self) -> None:
        """Jog up, as somebody at the machine does who must get at what lies there."""
        x, y, _ = self._plant.latch(time.monotonic()).position
        self._plant.disturbances.target = (x, y, TRAVELS["Z"][1])

    async def carry_out(self, method: str, arguments: str) -> str | None:
        """Go, or touch; the text of data.

        Raises
        ------
        IppCommandError
            For a collision, a place outside the travels, a surface that is not found.
        """
        given = dict(named_arguments(arguments))
        direction = given.pop("IJK", None)
        turned = given.pop("R", None) if method == "GoTo" and self.table else None
        if turned is not None:
            self._turn(float(turned))
        here = self._tip_at()
        to = here.copy()
        for name, value in given.items():
            if name not in AXES:
                raise IppCommandError(9, 1002, "Axis does not exist")
            to[AXES.index(name)] = float(value)
        if method == "GoTo":
            await self._go(to, self._properties["Tool.GoToPar.Speed"])
            return None
        if direction is None:
            raise IppCommandError(3, 509, "Bad argument")
        outward = np.array([float(part) for part in direction.split(",")])
        return await self._touch(to, outward / np.linalg.norm(outward))

    def _turn(self, angle: float) -> None:
        """Turn the table, at once: what stands on it must not come to where the tip is."""
        table = self.table
        if table is None or table.stuck:
            return
        here = self._tip_at()
        start = table.angle
        for part in np.linspace(0.0, 1.0, 2 + int(abs(angle - start))):
            table.angle = start + float(part) * (angle - start)
            self._look_for_collision(here, here)

    async def _touch(self, surface: Array, outward: Array) -> str:
        own = self._properties
        start = surface + (own["Tool.PtMeasPar.Approach"] + self._tip) * outward
        end = surface - own["Tool.PtMeasPar.Search"] * outward
        await self._go(start, own["Tool.GoToPar.Speed"])
        far = float(np.linalg.norm(end - start))
        way = 0.0
        for _ in range(_ROUNDS):
            # where it says that it is and where it is differ by what differs there
            error = self._error(start - way * outward)
            way = first_contact(start + error, -outward, self._centres(), self._reach)
            if self.gauge is not None:
                at = start + error
                way = min(way, self.gauge.contact(at, -outward, self._tip, self._part()))
            if way > far:
                break
        if way > far:
            await self._go(end, own["Tool.PtMeasPar.Speed"], searching=True)
            raise IppCommandError(2, 1006, "Surface not found")
        spread = self._plant.disturbances.repeatability
        contact = start - way * outward
        await self._go(contact, own["Tool.PtMeasPar.Speed"], searching=True)
        retract = own["Tool.PtMeasPar.Retract"]
        back = start if retract < 0.0 else contact + retract * outward
        await self._go(back, own["Tool.GoToPar.Speed"], searching=True)
        reported = [q + self._random.gauss(0.0, spread) for q in contact]
        return ", ".join(f"{a}({q:.5f})" for a, q in zip(AXES, reported, strict=True))

    @property
    def _reach(self) -> float:
        return self._tip + 0.5 * max((p.diameter for p in self.plates), default=0.0)

    def _temperatures(self) -> Array:
        return self._plant.latch(time.monotonic()).temperatures

    def _part(self) -> float:
        """Temperature of what lies there, °C."""
        return float(self._temperatures()[PLACES.index("T_amb")])

    def _centres(self) -> Array:
        found = [plate.centres(self._part()) for plate in self.plates]
        centres = np.concatenate(found) if found else np.zeros((0, 3))
        return centres if self.table is None else self.table.turned(centres)

    def _error(self, tip: Array) -> Array:
        plant = self._plant
        return plant.machine.error(tip - plant.tool, self._temperatures(), plant.tool)

    def _tip_at(self) -> Array:
        return np.asarray(self._plant.latch(time.monotonic()).position) + self._plant.tool

    async def _go(self, tip: Array, speed: float, *, searching: bool = False) -> None:
        axes = tip - self._plant.tool
        for name, q in zip(AXES, axes, strict=True):
            low, high = TRAVELS[name]
            if not low - 1e-6 <= q <= high + 1e-6:
                raise IppCommandError(3, 2500, f"Move out of limits: {name}")
        if not searching:
            self._look_for_collision(self._tip_at(), tip)
        plant = self._plant
        plant.speed = speed * self._hurry
        plant.disturbances.target = (float(axes[0]), float(axes[1]), float(axes[2]))
        plant.disturbances.go_to = True
        while True:
            await asyncio.sleep(0.001)
            if max(abs(self._tip_at() - tip)) <= _NEAR:
                return

    def _look_for_collision(self, start: Array, end: Array) -> None:
        """Say whether tip, shaft or plate meet on a way that is no search."""
        centres = self._centres()
        free = nearest(centres, start, end) - self._reach
        self.nearest_way = min(self.nearest_way, free)
        length = float(np.linalg.norm(end - start))
        steps = np.linspace(0.0, 1.0, 2 + int(length / _SHAFT_STEP))
        places = start + steps[:, None] * (end - start)
        hit = free < 0.0
        for plate in self.plates:
            own = places if self.table is None else self.table.at_zero(places)
            hit |= bool((plate.height(own) < 0.5 * plate.thickness + self._tip).any())
        if len(centres):
            over = centres[None, :, :] - places[:, None, :]
            beside = np.linalg.norm(over[..., :2], axis=2)
            room = self._reach - self._tip + self._shaft
            hit |= bool(((over[..., 2] > 0.0) & (beside < room)).any())
        if self.gauge is not None:
            hit |= bool((self.gauge.distance(places, self._part()) < self._tip).any())
            for high in np.arange(_SHAFT_STEP, _SHAFT, _SHAFT_STEP):
                shaft = places + np.array([0.0, 0.0, high])
                hit |= bool((self.gauge.distance(shaft, self._part()) < self._shaft).any())
        if hit:
            raise IppCommandError(3, 2504, "Collision")
