"""The path that the simulated machine moves along: smooth, and through the whole volume.

A programme of straight moves (with the jerk-free start and stop of a fifth-degree law), rests and
a Lissajous figure whose frequencies never close. Positions are a function of path time alone.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Protocol, TypeAlias

Point: TypeAlias = tuple[float, float, float]
"""Indicated X, Y, Z in mm."""

SPEED = 250.0
"""Fastest straight move, mm/s."""


class Segment(Protocol):
    """A piece of the path."""

    @property
    def duration(self) -> float:
        """How long it takes, s."""

    def position(self, time: float) -> Point:
        """Where the machine is a time (s) after the segment's start."""


@dataclass(frozen=True)
class Rest:
    """Standing still."""

    at: Point
    duration: float

    def position(self, time: float) -> Point:
        """The same place at all times."""
        return self.at


@dataclass(frozen=True)
class StraightMove:
    """A straight move with peak speed `speed` (mm/s), at rest at both ends."""

    start: Point
    end: Point
    speed: float = SPEED

    @property
    def duration(self) -> float:
        """The fifth-degree law's peak speed is 15/8 of the mean speed."""
        return 1.875 * math.dist(self.start, self.end) / self.speed

    def position(self, time: float) -> Point:
        """Share 10u³ − 15u⁴ + 6u⁵ of the way: no velocity or acceleration at the ends."""
        share = _smooth(time / self.duration) if self.duration > 0 else 1.0
        (ax, ay, az), (bx, by, bz) = self.start, self.end
        return (ax + share * (bx - ax), ay + share * (by - ay), az + share * (bz - az))


@dataclass(frozen=True)
class Lissajous:
    """``centre − amplitude · cos(ω s)``, with s speeding up from and slowing down to rest.

    Attributes
    ----------
    centre, amplitude
        mm.
    periods
        Of the three axes, s, at full speed.
    cruise
        Time at full speed, s; speeding up and slowing down take `RAMP` each.
    """

    centre: Point
    amplitude: Point
    periods: Point
    cruise: float

    RAMP = 4.0

    @property
    def duration(self) -> float:
        """With both ramps, s."""
        return self.cruise + 2.0 * self.RAMP

    def position(self, time: float) -> Point:
        """Where the figure is."""
        s = self._phase_time(time)
        x, y, z = (
            c - a * math.cos(2.0 * math.pi * s / p)
            for c, a, p in zip(self.centre, self.amplitude, self.periods, strict=True)
        )
        return (x, y, z)

    def _phase_time(self, time: float) -> float:
        """Integral of a speed that rises smoothly from 0 to 1 and falls back to 0."""
        total = self.duration
        if time > 0.5 * total:
            return self.cruise + self.RAMP - self._phase_time(total - time)
        u = min(max(time / self.RAMP, 0.0), 1.0)
        # ∫ (10u³ − 15u⁴ + 6u⁵) du = 2.5u⁴ − 3u⁵ + u⁶, which is 1/2 at u = 1.
        return self.RAMP * u**4 * (2.5 - 3.0 * u + u * u) + max(time - self.RAMP, 0.0)


class Path:
    """Segments one after the other, over and over."""

    def __init__(self, segments: Sequence[Segment]) -> None:
        self._segments = list(segments)
        self._ends = list(accumulate(segment.duration for segment in segments))

    @property
    def duration(self) -> float:
        """One round, s."""
        return self._ends[-1]

    def position(self, time: float) -> Point:
        """Where the machine is at a path time (s)."""
        time %= self.duration
        i = min(bisect_right(self._ends, time), len(self._segments) - 1)
        return self._segments[i].position(time - (self._ends[i - 1] if i else 0.0))


def bridge_path() -> Path:
    """The bridge's programme: four body diagonals, edges between them, and a Lissajous figure.

    It starts and ends at home (0, 0, 0), reaches every corner of the volume, and takes some
    100 s.
    """
    corners: list[Point] = [
        (0.0, 0.0, 0.0),
        (700.0, 900.0, -360.0),
        (0.0, 900.0, -360.0),
        (700.0, 0.0, 0.0),
    ]
    figure = Lissajous((350.0, 450.0, -180.0), (340.0, 440.0, 170.0), (11.3, 14.9, 6.7), 22.0)
    start, end = figure.position(0.0), figure.position(figure.duration)
    corners_after: list[Point] = [
        (700.0, 900.0, 0.0),
        (0.0, 0.0, -360.0),
        (700.0, 0.0, -360.0),
        (0.0, 900.0, 0.0),
        (0.0, 0.0, 0.0),
    ]
    segments: list[Segment] = [Rest(corners[0], 1.0)]
    segments += _visit([*corners, start])
    segments.append(figure)
    segments += _visit([end, *corners_after])
    return Path(segments)


def _visit(points: Sequence[Point]) -> list[Segment]:
    """Straight moves through points, with a short rest at each."""
    segments: list[Segment] = []
    for start, end in pairwise(points):
        segments += [StraightMove(start, end), Rest(end, 0.3)]
    return segments


def _smooth(u: float) -> float:
    u = min(max(u, 0.0), 1.0)
    return u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)
