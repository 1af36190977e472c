"""Approach directions that a campaign does not state, though its rows were read both ways."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]

_SAME = 1e-3
"""Positions within this are one, mm; rotary 1e-5 rad."""
_SAME_ANGLE = 1e-5
_FEWEST = 3
"""Targets of an axis that are read both ways before anything is said."""


def unsaid_approaches(campaign: Campaign) -> tuple[str, ...]:
    """Axes whose targets are come to from both sides, row after row, where no column says so.

    Without the approach direction (ISO 230-2, 3.5: ↑ and ↓) play is scatter, or a wave in time.
    """
    conditions = campaign.conditions
    order = np.argsort(conditions.time, kind="stable") if campaign.clocked else slice(None)
    setups = None if conditions.setup is None else conditions.setup[order]
    return tuple(
        axis
        for axis, at in conditions.positions.items()
        if not conditions.direction(axis).any()
        and _both_ways(at[order], setups, _SAME_ANGLE if is_rotary(axis) else _SAME)
    )


def _both_ways(at: F64, setups: NDArray[np.str_] | None, same: float) -> bool:
    """Whether enough targets are come to from below and from above, rows in their order."""
    way = np.diff(at)
    moved = np.abs(way) > same
    if setups is not None:
        moved &= setups[1:] == setups[:-1]
    targets = np.round(at[1:] / (2.0 * same)).astype(np.int64)
    upwards = set(targets[moved & (way > 0.0)].tolist())
    downwards = set(targets[moved & (way < 0.0)].tolist())
    return len(upwards & downwards) >= _FEWEST
