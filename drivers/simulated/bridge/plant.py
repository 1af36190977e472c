"""The machine while it runs: position, temperatures and sensors, latched cycle by cycle.

The controller has a cycle of 1 ms. A latch is what one cycle saw: all requests in the same
cycle get the same latch, and latches are kept for a while so that the truth can be looked up for
a sample that somebody answers later. The exact simulator is only asked when somebody asks it.
"""

from __future__ import annotations

import math
import random
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.climate import Climate, Ramp, SensorPlace
from abbe.drivers.simulated.bridge.machine import AXES, PLACES, TOOL, TRAVELS, BridgeMachine
from abbe.drivers.simulated.bridge.path import SPEED, Path, Point, StraightMove, bridge_path
from abbe.drivers.simulated.bridge.registers import ENCODERS, OHMS_PER_COUNT, THERMISTOR

Array = NDArray[np.float64]

CYCLE = 1e-3
"""Controller cycle, s."""

KEPT = 10_000
"""Number of latches that are remembered: 10 s of reading every cycle."""

SENSOR_NOISE = 0.002
"""Standard deviation of a thermistor's reading, K."""

OPEN = 0xFFFFFFFF
"""What the resistance register shows without a sensor."""


@dataclass
class Disturbances:
    """What is wrong with the machine just now; the server's fault registers set it.

    Attributes
    ----------
    thermistors_open, thermistors_short
        Bit k: sensor k of `PLACES`.
    encoders_frozen
        Bit k: axis k.
    repeatability
        Standard deviation of the true position about its mean, mm.
    stand_still, go_to
        Stop here; go to `target` and stay.
    target
        Indicated X, Y, Z, mm.
    heartbeat_stopped, machine_fault, unreferenced
        As they say.
    """

    thermistors_open: int = 0
    thermistors_short: int = 0
    encoders_frozen: int = 0
    repeatability: float = 0.3e-3
    stand_still: bool = False
    go_to: bool = False
    target: Point = (0.0, 0.0, 0.0)
    heartbeat_stopped: bool = False
    machine_fault: bool = False
    unreferenced: bool = False


@dataclass(frozen=True, slots=True)
class Latch:
    """What one controller cycle saw.

    Attributes
    ----------
    sample
        The cycle's number, from 1.
    time
        s on the caller's clock.
    position
        Indicated X, Y, Z, mm: whole encoder counts.
    counts
        The encoders' registers, which a frozen encoder leaves behind.
    directions
        In which direction each axis moved last.
    moving
        Whether any axis moved since the latch before.
    temperatures
        True temperatures of `PLACES`, °C.
    ohms
        The thermistors' registers, in 0.1 Ω.
    scatter
        Repeatability's share of the true position, mm.
    """

    sample: int
    time: float
    position: Point
    counts: tuple[int, int, int]
    directions: tuple[int, int, int]
    moving: bool
    temperatures: Array
    ohms: tuple[int, ...]
    scatter: Point


@dataclass
class Plant:
    """The running machine. Every call takes `now` (s), a clock that never goes back.

    Attributes
    ----------
    machine
        Its true errors.
    climate
        Temperatures of `PLACES` over shop time.
    start
        `now` at the beginning.
    time_factor
        Shop seconds per second: 60 makes a minute an hour of warming. Motion is not accelerated.
    seed
        Of the noise.
    tool
        Probe tip's offset, mm.
    encoders
        How the encoders are mounted.
    path
        Where it moves.
    speed
        Fastest move to a place off the path, mm/s.
    """

    machine: BridgeMachine
    climate: Climate
    start: float
    time_factor: float = 1.0
    seed: int = 0
    tool: Point = TOOL
    encoders: Mapping[str, Mapping[str, int]] = field(default_factory=lambda: ENCODERS)
    path: Path = field(default_factory=bridge_path)
    speed: float = SPEED
    disturbances: Disturbances = field(default_factory=Disturbances)

    def __post_init__(self) -> None:
        self._random = random.Random(f"plant {self.seed}")
        self._now = self.start
        self._shop_time = 0.0
        self._path_time = 0.0
        self._place: Point = self.path.position(0.0)
        self._detour: StraightMove | None = None
        self._detour_time = 0.0
        self._step = 0.0
        self._latches: OrderedDict[int, Latch] = OrderedDict()
        self._last: Latch | None = None
        self._true: dict[int, Point] = {}

    def pass_shop_time(self, seconds: float) -> None:
        """Let the hall's time go on by so much: where it goes by what the machine does."""
        self._shop_time += seconds

    def latch(self, now: float) -> Latch:
        """What the controller cycle at `now` sees; the same for all calls within a cycle."""
        sample = 1 + int((now - self.start) / CYCLE)
        last = self._last
        if last is not None and sample <= last.sample:
            return last
        self._advance(now)
        shown = [self._count(i, self._place[i]) for i in range(3)]
        position = (
            self._indicated(0, shown[0]),
            self._indicated(1, shown[1]),
            self._indicated(2, shown[2]),
        )
        before = position if last is None else last.position
        turned = [
            (q > p) - (q < p) or (0 if last is None else last.directions[i])
            for i, (q, p) in enumerate(zip(position, before, strict=True))
        ]
        wrapped = [
            last.counts[i]
            if last is not None and self.disturbances.encoders_frozen >> i & 1
            else (count + 2**31) % 2**32 - 2**31
            for i, count in enumerate(shown)
        ]
        temperatures = self.climate(self._shop_time) + self._step
        gauss, spread = self._random.gauss, self.disturbances.repeatability
        latch = Latch(
            sample,
            now,
            position,
            (wrapped[0], wrapped[1], wrapped[2]),
            (turned[0], turned[1], turned[2]),
            position != before,
            temperatures,
            self._resistances(temperatures),
            (gauss(0.0, spread), gauss(0.0, spread), gauss(0.0, spread)),
        )
        self._last = self._latches[sample & 0xFFFFFFFF] = latch
        if len(self._latches) > KEPT:
            _, forgotten = self._latches.popitem(last=False)
            self._true.pop(forgotten.sample, None)
        return latch

    def find(self, sample: int) -> Latch | None:
        """The latch of a cycle (its number's low 32 bits), if read and still remembered."""
        return self._latches.get(sample)

    def truth(self, latch: Latch) -> Point:
        """True X, Y, Z (mm) of a latch: indicated plus exact error plus repeatability.

        The tool's nominal offset is left out, so that it compares with axis positions.
        """
        known = self._true.get(latch.sample)
        if known is None:
            error = self.machine.error(latch.position, latch.temperatures, self.tool).tolist()
            x, y, z = (
                p + e + s for p, e, s in zip(latch.position, error, latch.scatter, strict=True)
            )
            known = self._true[latch.sample] = (x, y, z)
        return known

    def warm(self, kelvin: float) -> None:
        """Change all places' temperatures at once, for good."""
        self._step += kelvin

    def _advance(self, now: float) -> None:
        """Let the shop's time and the machine's motion go on until `now`."""
        elapsed, self._now = now - self._now, now
        self._shop_time += elapsed * self.time_factor
        wrong = self.disturbances
        if wrong.machine_fault or (wrong.stand_still and not wrong.go_to):
            return
        if wrong.go_to:
            self._travel(_inside(wrong.target), elapsed)
        elif self._detour is not None:
            if self._travel(self.path.position(self._path_time), elapsed):
                self._detour = None
        else:
            self._path_time += elapsed
            self._place = self.path.position(self._path_time)

    def _travel(self, target: Point, elapsed: float) -> bool:
        """Go on straight to a place off the path; True on arrival."""
        if self._detour is None or self._detour.end != target:
            self._detour, self._detour_time = StraightMove(self._place, target, self.speed), 0.0
        self._detour_time += elapsed
        self._place = self._detour.position(self._detour_time)
        return self._detour_time >= self._detour.duration

    def _count(self, axis: int, position: float) -> int:
        e = self.encoders[AXES[axis]]
        return e["zero"] + round(e["direction"] * position * e["counts_per_mm"])

    def _indicated(self, axis: int, count: int) -> float:
        e = self.encoders[AXES[axis]]
        return e["direction"] * (count - e["zero"]) / e["counts_per_mm"]

    def _resistances(self, temperatures: Array) -> tuple[int, ...]:
        wrong = self.disturbances
        shown = (temperatures + self.machine.sensor_errors).tolist()
        out = []
        for k, t in enumerate(shown):
            if wrong.thermistors_open >> k & 1:
                out.append(OPEN)
            elif wrong.thermistors_short >> k & 1:
                out.append(0)
            else:
                ohms = thermistor_ohms(t + self._random.gauss(0.0, SENSOR_NOISE))
                out.append(round(ohms / OHMS_PER_COUNT))
        return tuple(out)


def thermistor_ohms(temperature: float) -> float:
    """Resistance (Ω) of the thermistor at a temperature (°C).

    Steinhart–Hart solved for R in closed form: ln R is the real root of the depressed cubic
    ``c L³ + b L + (a − 1/T) = 0`` (Cardano).
    """
    a, b, c = THERMISTOR["a"], THERMISTOR["b"], THERMISTOR["c"]
    half = 0.5 * (a - 1.0 / (temperature + 273.15)) / c
    root = math.sqrt((b / (3.0 * c)) ** 3 + half * half)
    return math.exp(math.cbrt(root - half) - math.cbrt(root + half))


def shop_climate(seed: int) -> Climate:
    """A morning in the shop: 1.8 K warmer within an hour, later cooler again, air cycling.

    The places follow with lags of 5 to 20 minutes and stand up to 0.15 K apart.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, 20]))
    places = tuple(
        SensorPlace(name, float(rng.uniform(300.0, 1200.0)), float(rng.uniform(-0.15, 0.15)))
        for name in PLACES[:-1]
    )
    air = SensorPlace(PLACES[-1], 60.0, 0.0)
    ramps = (Ramp(0.0, 3600.0, 1.8), Ramp(3 * 3600.0, 2 * 3600.0, -1.2))
    return Climate((*places, air), 19.2, ramps, swing=0.12, period=2820.0)


def _inside(target: Point) -> Point:
    """The nearest place within the travels."""
    x, y, z = (
        min(max(q, TRAVELS[name][0]), TRAVELS[name][1])
        for q, name in zip(target, AXES, strict=True)
    )
    return (x, y, z)
