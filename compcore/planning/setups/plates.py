"""Set-ups of a calibrated ball plate that the machine itself touches: where it can lie.

The plate's own z looks along the stylus, or leans from it: what a stylus cannot reach is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.calibrated_plate import CalibratedPlate
from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.machine.machine import nominal_direction
from abbe.compcore.planning.instruments import PlannedInstrument
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.probing.touches import farthest_three
from abbe.compcore.planning.targets import SurveyTask

F64 = NDArray[np.float64]

_LEAN = np.radians(45.0)
_ASIDE, _OVER = 25.0, 60.0
"""Room that the tip needs beside the balls and over them, besides their radius, mm."""
FLAT, LEANING = (0.0, 1.0), (0.5,)
"""Heights at which a plate lies flat, and leans, parts of the room."""
CORNERS = ((0.0, 1.0), (0.0, 0.5, 1.0))
"""Where it lies in the other two directions, likewise; the wider room last."""


def probed_plates(
    task: SurveyTask,
    instrument: PlannedInstrument,
    plate: CalibratedPlate,
    flat: Sequence[float] = FLAT,
    leaning: Sequence[float] = LEANING,
    places: tuple[Sequence[float], Sequence[float]] = CORNERS,
) -> Iterator[PlannedSetup]:
    """A plate lying flat and turned, at two heights, and leaning four ways by 45°; six places each.

    A leaning plate is what a single vertical stylus sees the vertical axis by.

    Parameters
    ----------
    flat, leaning
        Heights, parts of the room that there is.
    places
        Where it lies in the other two directions, likewise; the wider room last.
    """
    if any(a not in task.machine.axes for a in "XYZ"):
        return
    tool, offset = next(iter(task.tools.items()))
    for words, turn, heights in _lies(np.asarray(offset), flat, leaning):
        own = plate.calibrated @ turn.T
        own = own - own.min(axis=0)
        size = own.max(axis=0)
        room = [_room(task, k, plate.diameter, turn, np.asarray(offset)) for k in range(3)]
        spare = np.array([high - low for low, high in room]) - size
        if (spare < 0.0).any():
            continue
        up = int(np.argmax(np.abs(_shaft(np.asarray(offset)))))
        one, two = sorted((k for k in range(3) if k != up), key=lambda k: spare[k])
        for height, less, more in product(heights, *places):
            part = np.zeros(3)
            part[[up, one, two]] = height, less, more
            tips = own + np.array([low for low, _ in room]) + part * spare
            targets = {a: np.full(len(own), v) for a, v in task.standing().items()}
            for k, a in enumerate("XYZ"):
                targets[a] = np.round(tips[:, k] - offset[k], 3)
            lies = ", ".join(f"{a} {targets[a].min():.0f} to {targets[a].max():.0f}" for a in "XYZ")
            made = PlannedSetup(
                instrument, f"ball plate {words}, {lies}",
                "", targets, np.tile(turn.T, (len(own), 1, 1)), Kind.DISPLACEMENT, ("frame",),
                np.full(len(own), instrument.uncertainty(float(np.linalg.norm(size)))),
                tool, offset, both_ways=False,
            )  # fmt: skip
            for i in farthest_three(plate.calibrated):
                x, y, z = made.path()[i].tolist()
                made.optics[f"ball {plate.points[i]}"] = (x, y, z)
            yield made


def _shaft(offset: F64) -> F64:
    """From the tip to the probe: along the machine's axis nearest to the tool."""
    away = -offset if offset.any() else np.array([0.0, 0.0, 1.0])
    k = int(np.argmax(np.abs(away)))
    return np.asarray(np.sign(away[k]) * np.eye(3)[k])


def _lies(
    offset: F64, flat: Sequence[float], leaning: Sequence[float]
) -> Iterator[tuple[str, F64, Sequence[float]]]:
    """How it lies: in words, the plate's axes as columns, and its heights, parts of the room."""
    normal = _shaft(offset)
    k = int(np.argmax(np.abs(normal)))
    one = np.eye(3)[(k + 1) % 3]
    two = np.cross(normal, one)
    first, second = ("XYZ"[int(np.argmax(np.abs(v)))] for v in (one, two))
    yield "flat", np.column_stack([one, two, normal]), flat
    yield "flat, turned by 90°", np.column_stack([two, -one, normal]), flat
    cos, sin = np.cos(_LEAN), np.sin(_LEAN)
    for along, across, name in ((one, two, first), (two, -one, second)):
        for sense in (1.0, -1.0):
            rising = cos * across + sense * sin * normal
            out = np.cross(along, rising)
            slope = "rising" if sense > 0.0 else "falling"
            yield (
                f"leaning by 45° about {name}, {slope}",
                np.column_stack([along, rising, out]),
                leaning,
            )


def _room(task: SurveyTask, k: int, diameter: float, turn: F64, offset: F64) -> tuple[float, float]:
    """Where the middles of balls may be along X, Y, Z (0, 1, 2), mm, as the tip counts."""
    low, high = task.ends("XYZ"[k])
    along = float(np.asarray(nominal_direction("XYZ"[k]))[k]) * turn[k, 2]
    # the tip comes from the side to which the plate looks
    over = _OVER * max(along, 0.0), _OVER * max(-along, 0.0)
    aside = _ASIDE + 0.5 * diameter
    return low + offset[k] + aside + over[1], high + offset[k] - aside - over[0]
