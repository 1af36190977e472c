"""The tormented machine's true motion: a known function of time, straight legs in three axes."""

from __future__ import annotations

import random
from bisect import bisect_right
from typing import NamedTuple

Place = tuple[float, float, float]
"""X, Y, Z in mm."""

TRAVEL: tuple[tuple[float, float], ...] = ((0.0, 600.0), (0.0, 500.0), (-400.0, 0.0))
"""Of X, Y, Z, mm."""
FASTEST = 300.0
"""mm/s in each axis."""


class _Leg(NamedTuple):
    begin: float
    place: Place
    velocity: Place

    def at(self, time: float) -> Place:
        elapsed = time - self.begin
        x, y, z = (p + v * elapsed for p, v in zip(self.place, self.velocity, strict=True))
        return x, y, z


class RandomMotion:
    """Random legs between points of the travel, some fast, some slow, some standing.

    Parameters
    ----------
    chance
        Where its randomness comes from.
    begin
        Monotonic time at which it sets out, s.
    """

    def __init__(self, chance: random.Random, begin: float) -> None:
        self._chance = chance
        self._legs: list[_Leg] = []
        self._begins: list[float] = []
        self._end = begin
        middle = tuple((low + high) / 2 for low, high in TRAVEL)
        self._add((middle[0], middle[1], middle[2]), (0.0, 0.0, 0.0), 0.5)

    def at(self, time: float) -> Place:
        """The truth at a monotonic time (s), mm."""
        while time >= self._end:
            self._go_on()
        return self._legs[max(0, bisect_right(self._begins, time) - 1)].at(time)

    def halt(self, begin: float, seconds: float) -> None:
        """Stand still from `begin` (monotonic, s; not in the past) for so long."""
        place = self.at(begin)
        while self._begins and self._begins[-1] >= begin:
            self._legs.pop()
            self._begins.pop()
        self._end = begin
        self._add(place, (0.0, 0.0, 0.0), seconds)

    def _add(self, place: Place, velocity: Place, seconds: float) -> None:
        self._legs.append(_Leg(self._end, place, velocity))
        self._begins.append(self._end)
        self._end += seconds

    def _go_on(self) -> None:
        place = self._legs[-1].at(self._end)
        way = [
            self._chance.choice((0.0, 0.02, 0.3, 1.0)) * (self._chance.uniform(*travel) - here)
            for travel, here in zip(TRAVEL, place, strict=True)
        ]
        seconds = max(self._chance.uniform(0.4, 2.5), max(map(abs, way)) / FASTEST)
        if self._chance.random() < 0.15:
            way = [0.0, 0.0, 0.0]
        x, y, z = (part / seconds for part in way)
        self._add(place, (x, y, z), seconds)
