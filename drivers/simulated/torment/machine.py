"""The tormented machine: what it shows at a moment, and what it holds of what it was given."""

from __future__ import annotations

import dataclasses
import math
import random
from collections.abc import Mapping

from abbe.drivers.simulated.torment.judge.evidence import AXES, Judge, ShownPicture, Taken
from abbe.drivers.simulated.torment.loop import Moment
from abbe.drivers.simulated.torment.motion import Place, RandomMotion
from abbe.drivers.simulated.torment.script import Script

RESOLUTION = 1e-5
"""mm: what positions are rounded to, on every wire."""
REFERENCED, FAULT = 4, 8
"""Bits of the machine's status word."""
BEATS = 50.0
"""The machine's heartbeat counts so fast, 1/s."""
TRUE_TEMPERATURES = (20.7, 21.3)
"""Lowest and highest that the X scale ever has, °C."""
POISON = 7.0
"""mm by which positions in foreign answers are off: nowhere near anything true."""


class TormentMachine:
    """The one machine behind all wires.

    Parameters
    ----------
    motion
        Where it is.
    script
        What goes wrong.
    judge
        Called with what went out and what came in.

    Attributes
    ----------
    held
        What it has of Abbe: X, Y, Z (mm), status, heartbeat, echo.
    """

    def __init__(self, motion: RandomMotion, script: Script, judge: Judge) -> None:
        self.motion = motion
        self.script = script
        self.judge = judge
        self.held: dict[str, float] = {}
        self._number = 0
        self._picture: ShownPicture | None = None
        self._stopped_beat: int | None = None
        self._mirrored: Place | None = None
        self._chance = random.Random(1)

    def look(self, now: float) -> ShownPicture:
        """The machine at a monotonic time (s), as it shows itself."""
        active = self.script.active
        if active("frozen", now) and self._picture is not None:
            return dataclasses.replace(self._picture, frozen=True)
        beat = int(now * BEATS)
        if active("heartbeat_frozen", now):
            beat = self._stopped_beat = self._stopped_beat or beat
        else:
            self._stopped_beat = None
        status = REFERENCED
        if lost := active("status_lost", now):
            status = 0 if lost.amount < 0.5 else REFERENCED | FAULT
        temperature = round(true_temperature(now), 3)
        if jump := active("sensor_jump", now):
            temperature = jump.amount
        if active("sensor_bad", now):
            temperature = math.nan
        x, y, z = (rounded(p) for p in self.motion.at(now))
        mirrored = None
        if active("mirrored", now) and all(axis in self.held for axis in AXES):
            x, y, z = (self.held[axis] for axis in AXES)
            mirrored = self._mirrored = self._mirrored or (x, y, z)
        self._number += 1
        place = (x, y, z)
        self._picture = ShownPicture(
            self._number, now, place, beat, status, temperature, mirrored=mirrored
        )
        return self._picture

    def poisoned(self, now: float) -> ShownPicture:
        """A picture of another machine, for answers that are not to be believed."""
        sign = self._chance.choice((-1.0, 1.0))
        x, y, z = (rounded(p + sign * POISON) for p in self.motion.at(now))
        number = self._chance.randrange(1, 1 << 30)
        return ShownPicture(number, now, (x, y, z), number, REFERENCED, 35.0)

    def take(self, moment: Moment, values: Mapping[str, float]) -> None:
        """The controller takes a message."""
        self.held.update(values)
        self.judge.taken(Taken(moment, dict(values)))

    def overwrite(self, now: float) -> dict[str, float]:
        """Somebody else writes into the registers that are Abbe's; hands back what."""
        x, y, z = self.motion.at(now)
        foreign = {"X": x + 0.05, "Y": y - 0.05, "Z": z + 0.05, "status": 0x7003, "heartbeat": 1}
        self.held.update(foreign)
        self.judge.overwritten(now)
        return foreign


def true_temperature(time: float) -> float:
    """Of the X scale at a monotonic time (s), °C."""
    low, high = TRUE_TEMPERATURES
    return (low + high) / 2 + (high - low) / 2 * math.sin(2.0 * math.pi * time / 60.0)


def rounded(position: float) -> float:
    """To the wire's resolution, mm."""
    return round(position / RESOLUTION) * RESOLUTION
