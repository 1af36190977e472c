"""Instruments on the simulated bridge: a laser's lengths, straightness, angles: the exact chain.

What is read is what the exact machine does, through noise: along, across or about the direction in
which the optics were placed, counted from wherever it was reset. It knows nothing of Abbe's models.
A reading is a line of text: ``OK +00123.456789``, or ``BEAM`` while the beam is broken; a broken
beam loses the count.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.plant import Latch, Plant

Array = NDArray[np.float64]
Reads = Literal["length", "error", "rotation", "distance"]


@dataclass
class Optics:
    """How the instrument stands.

    Attributes
    ----------
    reads
        ``length``: how far the point came along u; ``error``: across the way, what it left the
        straight line by; ``rotation``: about u, µrad; ``distance``: from `base`.
    u
        Direction, machine axes; of several readings at once one each.
    tool
        Where the moving optics sit, mm.
    base
        Of distances.
    length
        Of distances: what is taken off; a ball bar shows what its length differs from it by, mm.
    noise
        Standard deviation of a reading, mm (rotations: µrad).
    at
        A place of the line across which ``error`` is read, indicated, mm: what the machine stands
        aside of it shows, too. None: the machine never stands aside.
    slope
        By how much the optics are out of line, mm per mm of way; of ``error`` only.
    """

    reads: Reads = "length"
    u: tuple[tuple[float, float, float], ...] = ((1.0, 0.0, 0.0),)
    tool: tuple[float, float, float] = (0.0, 0.0, -150.0)
    base: tuple[float, float, float] = (0.0, 0.0, 0.0)
    length: float = 0.0
    at: tuple[float, float, float] | None = None
    noise: float = 1e-4
    slope: float = 0.0


@dataclass
class SimulatedLaser:
    """The instrument: an ASCII device (`LineServer`) that sees a plant.

    Attributes
    ----------
    plant
        The machine.
    seed
        Of its noise.
    optics
        How it stands now.
    beam
        Whether the light comes back.
    """

    plant: Plant
    seed: int = 0
    optics: Optics = field(default_factory=Optics)
    beam: bool = True
    factor: float = 1.0
    """What its counts are multiplied by: a turned sign, another unit; 0: it is frozen."""
    now: Callable[[], float] = time.monotonic
    _zero: Array | None = None
    _start: Array | None = None

    def __post_init__(self) -> None:
        self._random = random.Random(f"laser {self.seed}")

    def place(self, optics: Optics) -> None:
        """Set it up anew: it counts from here."""
        self.optics = optics
        self.reset()

    def reset(self) -> None:
        """Count from where it stands."""
        self._zero = self._start = None

    def break_beam(self, *, broken: bool) -> None:
        """Break the beam, or let it pass again; the count is lost."""
        self.beam = not broken
        self.reset()

    def answer(self, query: str) -> str | None:
        """``R``: the reading; ``Z``: reset; anything else ``?``."""
        if query == "Z":
            self.reset()
            return "OK"
        return self.spontaneous() if query == "R" else "?"

    def spontaneous(self) -> str:
        """The reading as a line."""
        if not self.beam:
            return "BEAM"
        return "OK " + " ".join(f"{x:+015.7f}" for x in self.reading())

    def reading(self) -> list[float]:
        """What it shows now, mm or µrad."""
        latch = self.plant.latch(self.now())
        seen = self._seen(latch)
        if self._zero is None:
            self._zero = seen
        absolute = self.optics.reads == "distance"
        noise = [self._random.gauss(0.0, self.optics.noise) for _ in range(len(seen))]
        shown = (seen if absolute else seen - self._zero) + self._aside(latch) + np.array(noise)
        return [float(x) * self.factor for x in shown]

    def _aside(self, latch: Latch) -> Array:
        """What it shows of the machine standing aside of its line, mm."""
        optics = self.optics
        if optics.reads != "error" or optics.at is None:
            return np.zeros(len(optics.u))
        aside: Array = np.array(optics.u) @ (np.array(latch.position) - np.array(optics.at))
        return aside

    def slip(self, by: float) -> None:
        """Lose counts without a word, mm (rotations: µrad)."""
        if self._zero is None:
            self.reading()
        if self._zero is not None:
            self._zero = self._zero - by

    def _seen(self, latch: Latch) -> Array:
        machine, optics = self.plant.machine, self.optics
        u = np.array(optics.u)
        if optics.reads == "rotation":
            state = machine.state(latch.position, latch.temperatures)
            turned: Array = u @ machine.exact.orientation_error(state) * 1e6
            return turned
        error = machine.error(latch.position, latch.temperatures, optics.tool)
        error = error + np.array(latch.scatter)
        if optics.reads == "error":
            place = np.array(latch.position)
            if self._start is None:
                self._start = place
            away = float(np.linalg.norm(place - self._start))
            across: Array = u @ error + optics.slope * away
            return across
        point = np.array(latch.position) + np.array(optics.tool) + error
        if optics.reads == "distance":
            return np.array([float(np.linalg.norm(point - np.array(optics.base))) - optics.length])
        along: Array = u @ point
        return along
