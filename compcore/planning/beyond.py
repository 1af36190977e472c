"""How far axes go beyond a target that they would meet from the wrong side, to come back to it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.planned_setup import PlannedSetup

HELD = 0.2
"""mm that a set-up goes beyond whose instrument is held by the tool: a ball bar's range is 1 mm."""
_HELD_TURN = math.radians(0.1)
_STRAIGHT = 1e-3
"""mm that the targets of a straight line may lie beside it: they are rounded."""


def beyond_of(setup: PlannedSetup, beyond: float) -> Mapping[str, float]:
    """Axis → how far it goes beyond a target of a set-up, mm or rad; of axes that move.

    On a diagonal all axes go beyond along the line itself: beside it a laser loses its beam.

    Parameters
    ----------
    beyond
        The plan's, mm; rotary axes the same number of degrees / 10.
    """
    moving = {a: q for a, q in setup.targets.items() if float(np.ptp(q)) > 0.0}
    usual = {a: math.radians(0.1 * beyond) if is_rotary(a) else beyond for a in moving}
    if setup.instrument.held:
        return {a: min(v, _HELD_TURN if is_rotary(a) else HELD) for a, v in usual.items()}
    if len(moving) < 2 or any(is_rotary(a) for a in moving):
        return usual
    at = np.stack(list(moving.values()), axis=1)
    way = at[-1] - at[0]
    length = float(np.linalg.norm(way))
    if length == 0.0:
        return usual
    along = way / length
    beside = (at - at[0]) - np.outer((at - at[0]) @ along, along)
    if float(np.abs(beside).max()) > _STRAIGHT:
        return usual
    share = np.abs(way) / float(np.abs(way).max())
    least = min(beyond, HELD)
    return {a: max(beyond * float(s), least) for a, s in zip(moving, share, strict=True)}
