"""The way of an R-test from target to target: X, Y, Z follow the sphere while an axis turns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from abbe.compcore.iso10791.poses import following
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.planned_setup import PlannedSetup

_BESIDE = 0.1
"""mm by which a straight move may lead the sphere out of its place: an R-test's range is 1 mm."""


def legs_between(
    machine: Machine, setup: PlannedSetup, start: Mapping[str, float], end: Mapping[str, float]
) -> list[dict[str, float]]:
    """Places on the way, axis → mm or rad, without its ends; none where the straight way is fine.

    On a straight move all axes go evenly, and the sphere follows the chord of its arc.
    """
    turns = any(is_rotary(a) and start[a] != q for a, q in end.items())
    if not (setup.instrument.held and turns):
        return []
    offset = np.asarray([setup.offset])
    point = Chain(
        machine, Conditions({a: np.array([q]) for a, q in end.items()}, tool=offset)
    ).point
    middle = {a: np.array([0.5 * (start[a] + q)]) for a, q in end.items()}
    beside = Chain(machine, Conditions(middle, tool=offset)).point - point
    pieces = int(np.ceil(np.sqrt(float(np.linalg.norm(beside)) / _BESIDE)))
    if pieces < 2:
        return []
    part = np.arange(1, pieces) / pieces
    others = {a: start[a] + part * (q - start[a]) for a, q in end.items() if a not in "XYZ"}
    at = following(machine, others, np.tile(point, (len(part), 1)), np.tile(offset, (len(part), 1)))
    return [{a: float(q[i]) for a, q in at.items()} for i in range(len(part))]
