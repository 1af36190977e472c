"""How a stylus touches a sphere: directions that it can reach, and ways about the sphere.

All places are those of the middle of the stylus's tip. A sphere sits on a body (a plate, a post)
and looks out of it along its `normal`; the shaft of the stylus goes from the tip along `shaft`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError

F64 = NDArray[np.float64]

OVER_PLATE = math.radians(65.0)
"""Farthest from the normal that a touch may be: nearer to the body there is the body."""
OVER_POST = math.radians(100.0)
"""The same of a sphere on a post of its own, at least as thin as the sphere."""
_CAP = math.radians(60.0)
"""Of the ring from its pole, where nothing hinders."""
_LEAST_CAP = math.radians(35.0)
"""A smaller cap says nothing of the centre along its pole."""


@dataclass(frozen=True, slots=True)
class Stylus:
    """What touches.

    Attributes
    ----------
    tip
        Radius of its ball, mm.
    shaft
        Unit vector from the tip to the probe.
    """

    tip: float
    shaft: tuple[float, float, float]


def _most_lean(over: float) -> float:
    """By which a stylus may lean, rad, where touches may be `over` from the normal."""
    return 2.0 * (min(over, 0.5 * math.pi) - _LEAST_CAP)


MOST_LEAN = _most_lean(OVER_POST)
"""By which the stylus may lean from a post and still get round the sphere on it."""


def directions(normal: F64, stylus: Stylus, count: int, over: float = OVER_PLATE) -> F64:
    """Where the tip stands seen from a sphere's middle when it touches it, unit vectors (n, 3).

    The pole of a cap first, then a ring about it: on the side that looks out of the body, and so
    that the shaft passes the sphere.

    Parameters
    ----------
    over
        Farthest from the normal that a touch may be, rad.

    Raises
    ------
    InputError
        When the stylus cannot reach the side that looks out.
    """
    shaft = np.asarray(stylus.shaft)
    lean = math.acos(float(np.clip(normal @ shaft, -1.0, 1.0)))
    cap = min(_CAP, over - 0.5 * lean, 0.5 * math.pi - 0.5 * lean)
    if cap < _LEAST_CAP - 1e-9:
        raise InputError(
            "the stylus cannot reach round the spheres",
            field="stylus",
            found=f"{math.degrees(lean):.0f}° between the stylus and what the spheres stand on",
            expected=f"at most {math.degrees(_most_lean(over)):.0f}°",
        )
    pole = (normal + shaft) / np.linalg.norm(normal + shaft)
    across = np.cross(pole, np.eye(3)[int(np.argmin(np.abs(pole)))])
    across /= np.linalg.norm(across)
    beside = np.cross(pole, across)
    angle = np.linspace(0.0, 2.0 * np.pi, count - 1, endpoint=False) + 0.25 * np.pi
    ring = math.cos(cap) * pole + math.sin(cap) * (
        np.outer(np.cos(angle), across) + np.outer(np.sin(angle), beside)
    )
    return np.vstack([pole, ring])


def about(centre: F64, start: F64, end: F64, radius: float, least: float) -> Iterator[F64]:
    """Places on the way about a sphere between two directions, the last included; none if alike.

    Parameters
    ----------
    start, end
        Unit vectors.
    radius
        From the middle at which the tip goes, mm.
    least
        From the middle to which straight lines between the places must keep, mm; below `radius`.
    """
    turn = math.acos(float(np.clip(start @ end, -1.0, 1.0)))
    if turn < 1e-6:
        return
    steps = math.ceil(0.5 * turn / math.acos(least / radius))
    for i in range(1, steps + 1):
        part = i / steps
        mixed = math.sin((1.0 - part) * turn) * start + math.sin(part * turn) * end
        yield centre + radius * mixed / math.sin(turn)


def round_trip(
    centre: F64, ways: F64, away: float, least: float
) -> Iterator[tuple[F64, F64 | None]]:
    """The way about a sphere from touch to touch, and back to the first direction.

    Yields
    ------
    A place to which the tip goes straight, and the direction along which it then touches; None: it
    only goes on.

    Parameters
    ----------
    ways
        Directions of the touches, unit vectors (n, 3); it begins and ends `away` along the first.
    away, least
        As `about` takes them.
    """
    at = ways[0]
    yield centre + away * at, None
    for way in ways:
        for place in about(centre, at, way, away, least):
            yield place, None
        at = way
        yield centre + away * way, way
    for place in about(centre, at, ways[0], away, least):
        yield place, None


def farthest_three(places: F64) -> tuple[int, int, int]:
    """Three of some places (n, 3) that span them: the first, the farthest, the one most beside.

    Raises
    ------
    ValueError
        When they lie on one line.
    """
    away = np.linalg.norm(places - places[0], axis=1)
    second = int(np.argmax(away))
    line = (places[second] - places[0]) / max(away[second], 1e-12)
    offset = places - places[0]
    beside = np.linalg.norm(offset - np.outer(offset @ line, line), axis=1)
    third = int(np.argmax(beside))
    if beside[third] < 1e-3 * max(away[second], 1e-12):
        raise ValueError("the places lie on one line")
    return 0, second, third


def unit(vector: Sequence[float]) -> F64:
    """A vector made to length 1."""
    found = np.asarray(vector, dtype=np.float64)
    return np.asarray(found / np.linalg.norm(found))
