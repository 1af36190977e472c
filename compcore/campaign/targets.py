"""Targets: the places along an axis at which it was read again and again (ISO 230-2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions

F64 = NDArray[np.float64]

_APART = 10.0
"""Targets are apart by at least so many times what the machine does not repeat at one of them."""

_REPEATS = 1e-2
"""What a machine that returns to a target does not repeat, at most, mm; of rad ten times finer."""

_BESIDE = 0.1
"""Part of the greatest step by which a target may lie elsewhere on the way back."""

_FEWEST_PAIRS = 4
_VISITS = 2
"""Readings of each target, on average, from which on they are targets and no sweep."""

_IN_ONE, _PARTS = 100, 1000
"""Unit vectors are told apart in hundredths."""


def targets(conditions: Conditions, axis: str, *, rotary: bool) -> F64:
    """The targets at which an axis was read, increasing, shape (m,), mm or rad.

    A scale that is read back never shows the same figure twice: what lies much nearer together than
    the targets are apart is one of them, at the mean. Empty where the axis was read on its way, or
    at most places once. Several components that were read at one stand are no several readings:
    the component that was read most often counts.

    Parameters
    ----------
    conditions
        The rows.
    axis
        The axis.
    rotary
        Whether its positions are rad.
    """
    at = conditions.position(axis)[_one_component(conditions)]
    ordered = np.sort(at)
    gaps = np.diff(ordered)
    alike = 0.1 * _REPEATS if rotary else _REPEATS
    apart = np.unique(gaps)[::-1]
    # the greatest gap that is left within a target
    inside = np.append(apart[1:], 0.0)
    for least in apart[(apart > alike) & (inside <= np.minimum(alike, apart / _APART))]:
        cuts = np.flatnonzero(gaps >= least) + 1
        first, last = np.append(0, cuts), np.append(cuts, len(ordered)) - 1
        within = float(np.max(ordered[last] - ordered[first]))
        # where gaps are alike there may be more
        enough = len(ordered) >= _VISITS * len(first)
        if enough and within <= min(alike, least / _APART):
            found = np.array([float(np.mean(part)) for part in np.split(ordered, cuts)])
            return _from_both_sides(found, conditions, axis)
    return ordered[:0]


def _from_both_sides(found: F64, conditions: Conditions, axis: str) -> F64:
    """Targets; those of which one is met on the way there only, the other on the way back, are one.

    A run back often begins a little beyond the last target and stops as much beside all others:
    what lies between such two is play, and no slope of the error.
    """
    if len(found) < _FEWEST_PAIRS:
        return found
    gaps = np.diff(found)
    near = gaps < _BESIDE * gaps.max()
    way = conditions.direction(axis)
    nearest = np.searchsorted(0.5 * (found[1:] + found[:-1]), conditions.position(axis))
    up, down, neither = (
        np.bincount(nearest[rows], minlength=len(found)) > 0
        for rows in (way > 0.0, way < 0.0, ~(way > 0.0) & ~(way < 0.0))
    )
    for k in np.flatnonzero(near):
        two = slice(k, k + 2)
        both = up[two].sum() == down[two].sum() == 1 and not neither[two].any()
        if (k and near[k - 1]) or not both or (up[k] and down[k]):
            return found
    return np.array([float(np.mean(part)) for part in np.split(found, np.flatnonzero(~near) + 1)])


def _one_component(conditions: Conditions) -> NDArray[np.bool_]:
    """The rows of the component that was measured most often, shape (n,)."""
    number = np.zeros(conditions.n, dtype=np.int64)
    if conditions.u is not None:
        for part in np.nan_to_num(conditions.u).T:
            number = number * _PARTS + np.rint(part * _IN_ONE).astype(np.int64)
    if conditions.kind is not None:
        number = number * _PARTS + conditions.kind
    _, which, counts = np.unique(number, return_inverse=True, return_counts=True)
    chosen: NDArray[np.bool_] = which == int(np.argmax(counts))
    return chosen
