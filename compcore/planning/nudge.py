"""A small known move across a line before its first target, which its instrument has to show.

What reads errors has no nominal reading: another unit, a turned sign, or a display that is seconds
late shows nowhere. Where the axes across the line do not move otherwise, they can show it.
"""

from __future__ import annotations

import numpy as np

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.machine.machine import Machine, nominal_direction
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.planned_setup import PlannedSetup

NUDGE = 0.05
"""mm: within the range of a lever indicator, many times what its unit's mistake would leave."""
_SHOW_IT = frozenset({"indicator", "straightness"})
"""Instruments that show a move across their line."""
_PARTS = (1.0, 0.6, 0.36)
"""Of the nudge along each direction that is read: exchanged ones show, too."""


def nudge_of(machine: Machine, setup: PlannedSetup, amount: float) -> dict[str, float]:
    """Axis → by how much it moves for a set-up's nudge, mm; empty where there is none.

    Parameters
    ----------
    amount
        The plan's, mm; 0: none.
    """
    if amount <= 0.0 or setup.instrument.key not in _SHOW_IT or setup.kind != Kind.DISPLACEMENT:
        return {}
    moving = [a for a, q in setup.targets.items() if float(np.ptp(q)) > 0.0]
    if any(is_rotary(a) for a in moving):
        return {}
    u = setup.u[0] / np.linalg.norm(setup.u[0], axis=1)[:, None]
    if len(u) > len(_PARTS) or np.abs(u @ u.T - np.eye(len(u))).max() > 1e-6:
        return {}
    way = amount * np.array(_PARTS[: len(u)]) @ u
    found: dict[str, float] = {}
    left = np.array(way)
    for axis, at in setup.targets.items():
        if axis in moving or is_rotary(axis):
            continue
        direction = np.asarray(nominal_direction(axis))
        along = float(left @ direction)
        if abs(along) < 1e-9:
            continue
        low, high = machine.axes[axis].travel
        if not (low <= at[0] - abs(along) and at[0] + abs(along) <= high):
            return {}
        found[axis] = along
        left = left - along * direction
    return found if float(np.abs(left).max()) < 1e-9 else {}
