"""The scenarios: what happens in the shop, which thermometers there are, what is measured where."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from benchmarks.thermal.weather import Shop


@dataclass(frozen=True)
class Sensor:
    """A thermometer.

    Attributes
    ----------
    name, role, axis
        As in the model file; no axis: empty.
    body
        What it sits on (`bodies.BODIES`), or ``air``, ``coolant``.
    loose
        Which part of what it reads is the air beside it.
    """

    name: str
    role: str
    body: str
    loose: float = 0.0
    axis: str = ""


AIR = Sensor("T_air", "ambient", "air")
BEARING = Sensor("T_bearing", "spindle", "bearing", 0.05)
HEAD = Sensor("T_head", "structure", "head", 0.1)
FRONT = Sensor("T_front", "structure", "front", 0.15)
REAR = Sensor("T_rear", "structure", "rear", 0.15)
BED = Sensor("T_bed", "structure", "bed", 0.2)
TABLE = Sensor("T_table", "structure", "table", 0.1)
COOLANT = Sensor("T_coolant", "coolant", "coolant")
SCALE_X = Sensor("T_x", "scale", "scale_x", 0.05, "X")
SCALE_Y = Sensor("T_y", "scale", "scale_y", 0.05, "Y")
CABINET = Sensor("T_cabinet", "other", "rear", 0.7)
CEILING = Sensor("T_ceiling", "ambient", "air", 0.4)

Place = tuple[float, float, float]

ONE: tuple[tuple[Place, str], ...] = (((400.0, 0.0, 250.0), "XYZ"),)
"""Three probes at a sphere in one place."""
FOUR: tuple[tuple[Place, str], ...] = tuple(
    (place, "XYZ")
    for place in (
        (100.0, -200.0, 50.0),
        (700.0, -200.0, 450.0),
        (100.0, 200.0, 450.0),
        (700.0, 200.0, 50.0),
    )
)
"""Four spheres on a plate that does not expand."""
LINES: tuple[tuple[Place, str], ...] = (
    *(((x, 0.0, 250.0), "X") for x in (0.0, 200.0, 400.0, 600.0, 800.0)),
    *(((400.0, y, 250.0), "Y") for y in (-250.0, -125.0, 0.0, 125.0, 250.0)),
)
"""A scale beside X and one beside Y, five positions each."""


@dataclass(frozen=True)
class Scenario:
    """One machine in one shop.

    Attributes
    ----------
    name
        In words.
    shop, sensors, points
        What happens; the thermometers; places and what is measured there.
    speed
        Whether the spindle's speed is recorded.
    every
        Seconds from round to round.
    warms
        Whether the machine moves when it warms; else temperatures do all the same, and nothing
        else than noise is measured.
    """

    name: str
    shop: Shop
    sensors: tuple[Sensor, ...]
    points: tuple[tuple[Place, str], ...] = ONE
    speed: bool = False
    every: float = 300.0
    warms: bool = True


_EVERYTHING = Shop(1.5, 4, sun=True, spindle=True, coolant=True, pump=True)
_ALL = (AIR, BEARING, HEAD, FRONT, REAR, BED, TABLE, COOLANT)

SCENARIOS = (
    Scenario("spindle at work", Shop(0.4, spindle=True), (AIR, BEARING, HEAD, BED)),
    Scenario(
        "spindle at work, its speed alone recorded", Shop(0.4, spindle=True), (AIR, BED), speed=True
    ),
    Scenario(
        "spindle at work until the first reading",
        Shop(0.4, spindle=True, before_work=True),
        (AIR, BEARING, BED),
    ),
    Scenario("air and doors", Shop(2.5, 6), (AIR, BED)),
    Scenario("air and doors, one loose thermometer", Shop(2.5, 6), (CEILING,)),
    Scenario("sun on the column", Shop(0.8, sun=True), (AIR, FRONT, REAR)),
    Scenario("sun on the column, four places", Shop(0.8, sun=True), (AIR, FRONT, REAR), FOUR),
    Scenario("coolant", Shop(0.5, coolant=True), (AIR, COOLANT, BED)),
    Scenario("everything, eight thermometers", _EVERYTHING, _ALL),
    Scenario(
        "everything, ten alike and collinear",
        Shop(2.5, 4, sun=True, pump=True),
        (AIR, CEILING, CABINET, FRONT, REAR, BED, TABLE, SCALE_X, SCALE_Y, HEAD),
    ),
    Scenario("everything, four places", _EVERYTHING, _ALL, FOUR),
    Scenario("everything, a reading each 20 minutes", _EVERYTHING, _ALL, every=1200.0),
    Scenario("scales in a warm day", Shop(2.5, 3, coolant=True), (AIR, SCALE_X, SCALE_Y), LINES),
    Scenario("hydraulics that nobody measures", Shop(0.3, pump=True), (AIR, BEARING)),
)

EMPTY = (
    Scenario("empty, one place", _EVERYTHING, _ALL, warms=False),
    Scenario("empty, four places", _EVERYTHING, _ALL, FOUR, every=900.0, warms=False),
    Scenario("empty, two thermometers", Shop(2.0, 4), (AIR, BED), warms=False),
    Scenario("empty, each 20 minutes", _EVERYTHING, _ALL, every=1200.0, warms=False),
)


@dataclass(frozen=True)
class Run:
    """A scenario with its seed."""

    scenario: Scenario
    seed: int


def runs(seeds: int = 2, empty: int = 100) -> Iterator[Run]:
    """Every scenario with some seeds, and so many empty days, each kind in turn."""
    for k in range(empty):
        yield Run(EMPTY[k % len(EMPTY)], 9_000 + k)
    for k in range(seeds):
        for i, scenario in enumerate(SCENARIOS):
            yield Run(scenario, 7_000 + 100 * i + k)
