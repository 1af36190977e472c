"""One machine of a fleet: it moves, it warms, it probes four spheres on its table when told to.

Input registers: X, Y, Z (mm) and its thermometers (°C) as float32 from 0 on; 30: heartbeat; from
100 on eight for each sphere: how often it was probed, a spare, where it was found (mm, float32).
Holding registers: 0 status word, 1 heartbeat, from 10 on corrected X, Y, Z (mm, float32).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.checks import PROBING, QUALIFYING, SPHERES
from abbe.drivers.simulated.bridge.device import NotWritableError, Ranges, WireFaults
from abbe.drivers.simulated.bridge.happened import Happened
from abbe.drivers.simulated.bridge.machine import AXES, PLACES, TRAVELS, make_bridge
from abbe.drivers.simulated.bridge.plant import SENSOR_NOISE
from abbe.drivers.simulated.registers import Table

Array = NDArray[np.float64]

TEMPERATURES_AT, HEARTBEAT_AT, SPHERES_AT, CORRECTED_AT = 6, 30, 100, 10
PER_SPHERE = 8
_INPUTS = SPHERES_AT + PER_SPHERE * len(SPHERES)
_HOLDINGS = CORRECTED_AT + 2 * len(AXES)
_PERIODS = (19.0, 23.0, 29.0)
"""s in which X, Y and Z go to and fro."""
_WARMS = 0.6
"""K by which a hall is warmer in the middle of a day."""
_DAY = 86_400.0


class SimulatedFleetMachine:
    """One machine.

    Parameters
    ----------
    seed
        Which machine, as `make_bridge` numbers them.
    number
        Of the fleet: another phase of its moves, another hall.
    happened
        What has happened to it.
    stands
        Where each sphere is, as it was found when it was put there, mm.
    """

    ranges: ClassVar[Ranges] = {
        "coil": ((0, 16),),
        "discrete": ((0, 16),),
        "holding": ((0, _HOLDINGS),),
        "input": ((0, _INPUTS),),
    }

    def __init__(
        self, seed: int, number: int, happened: Happened, stands: Mapping[str, Sequence[float]]
    ) -> None:
        self.wire = WireFaults()
        self._machine = happened.to(make_bridge(seed))
        self._number, self._stands = number, stands
        self._rng = np.random.default_rng(np.random.SeedSequence([seed, number, 17]))
        self._found: dict[str, tuple[int, Array]] = {n: (0, np.zeros(3)) for n in SPHERES}
        self._written = [0] * _HOLDINGS
        self._first: float | None = None
        self.writes = 0

    def probe(self, now: float) -> None:
        """Probe all spheres at `now`, s of the clock by which it is read.

        The probe is qualified anew, then each is found.
        """
        probe = QUALIFYING * self._rng.normal(size=3)
        for name, place in SPHERES.items():
            error = self._machine.error(np.array(place), self._temperatures(now))
            scatter = probe + PROBING * self._rng.normal(size=3)
            found = np.asarray(self._stands[name]) - error - scatter
            self._found[name] = (self._found[name][0] + 1, found)

    def read(self, table: Table, address: int, count: int, now: float) -> list[int]:
        """Words as they are at this moment."""
        words = self._inputs(now) if table == "input" else self._written
        if table not in ("input", "holding"):
            words = [0] * 16
        return words[address : address + count]

    def write(self, table: Table, address: int, values: Sequence[int], now: float) -> None:
        """Take what Abbe writes."""
        if table != "holding":
            raise NotWritableError(table)
        self._written[address : address + len(values)] = values
        self.writes += 1

    def _inputs(self, now: float) -> list[int]:
        words = [0] * _INPUTS
        shown = self._temperatures(now) + self._machine.sensor_errors
        shown = shown + SENSOR_NOISE * self._rng.normal(size=len(PLACES))
        _put(words, 0, self._position(now))
        _put(words, TEMPERATURES_AT, shown)
        words[HEARTBEAT_AT] = int(10.0 * now) & 0xFFFF
        for k, (count, found) in enumerate(self._found.values()):
            at = SPHERES_AT + PER_SPHERE * k
            words[at] = count
            _put(words, at + 2, found)
        return words

    def _position(self, now: float) -> Array:
        phase = [2.0 * math.pi * (now / p + 0.13 * self._number) for p in _PERIODS]
        ends = [TRAVELS[axis] for axis in AXES]
        way = zip(ends, phase, strict=True)
        return np.array([0.5 * (a + b) + 0.4 * (b - a) * math.sin(p) for (a, b), p in way])

    def _temperatures(self, now: float) -> Array:
        self._first = now if self._first is None else self._first
        at = 2.0 * math.pi * ((now - self._first) / _DAY + 0.07 * self._number)
        hall = 20.0 + _WARMS * math.sin(at)
        return np.array([hall + 0.03 * math.sin(at + k) for k in range(len(PLACES))])


def _put(words: list[int], at: int, values: Array) -> None:
    """float32, high word first."""
    data = struct.pack(f">{len(values)}f", *values)
    words[at : at + 2 * len(values)] = struct.unpack(f">{2 * len(values)}H", data)
