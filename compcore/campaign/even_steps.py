"""Axes that a campaign reads at even steps only: a short wave there looks like a longer one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.targets import targets
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]

_SAME = 1e-3
"""Positions within this are one, mm; rotary 1e-5 rad."""
_SAME_ANGLE = 1e-5
_STILL = 0.01
"""Part of its travel by which an axis may move in a set-up in which it stands."""
_EVEN = 0.02
"""Part of the step by which positions may lie beside the lattice."""
_NEAR = 0.25
_FEWEST = 5


def even_steps(conditions: Conditions) -> dict[str, float]:
    """Axis → the step of the one lattice on which all its lines are read, mm or rad.

    Of axes that are read anywhere else too nothing is said: their lines together may tell a short
    wave from a long one. Set-ups in which an axis stands say nothing of its waves.
    """
    found = {}
    for axis, at in conditions.positions.items():
        same = _SAME_ANGLE if is_rotary(axis) else _SAME
        step = _lattice(at[_moves(conditions, at, same)], same)
        if step is not None:
            found[axis] = step
    return found


def places(conditions: Conditions) -> dict[str, int]:
    """Axis → at how many places it was read; targets that were met again and again count once."""
    found = {}
    for axis, at in conditions.positions.items():
        if not len(at):
            continue
        rotary = is_rotary(axis)
        aimed = targets(conditions, axis, rotary=rotary)
        if len(aimed) > 1 and _all_near(at, aimed):
            found[axis] = len(aimed)
            continue
        same = _SAME_ANGLE if rotary else _SAME
        found[axis] = 1 + int((np.diff(np.sort(at)) > same).sum())
    return found


def _all_near(at: F64, aimed: F64) -> bool:
    """Whether every position is nearer to its target than a quarter of the least step."""
    middles = 0.5 * (aimed[1:] + aimed[:-1])
    away = np.abs(at - aimed[np.searchsorted(middles, at)])
    return bool(away.max() < _NEAR * float(np.diff(aimed).min()))


def _moves(conditions: Conditions, at: F64, same: float) -> NDArray[np.bool_]:
    """Rows of set-ups in which an axis moves."""
    least = max(same, _STILL * float(np.ptp(at))) if len(at) else same
    if conditions.setup is None:
        return np.full(len(at), len(at) > 0 and float(np.ptp(at)) > least)
    setups = conditions.setup_rows()
    count = len(setups.index)
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, setups.number, at)
    np.maximum.at(high, setups.number, at)
    moving: NDArray[np.bool_] = (high - low > least)[setups.number]
    return moving


def _lattice(at: F64, same: float) -> float | None:
    """The step of the lattice on which positions lie; None where they lie on none."""
    places = np.sort(at)
    places = places[np.diff(places, prepend=-np.inf) > same]
    if len(places) < _FEWEST:
        return None
    away = places - places[0]
    number = np.round(away / np.diff(places).min())
    step = float(away[-1] / number[-1])
    return step if float(np.abs(away - number * step).max()) <= _EVEN * step else None
