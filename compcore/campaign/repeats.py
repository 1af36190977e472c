"""Repeated measurements in a campaign: rows that differ in nothing but the moment."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

SAME_POSITION = 0.01
"""Positions within this are the same, mm: at a slope of 100 µm/m it costs 1 nm."""
SAME_ANGLE = 1e-5
"""Rotary positions within this are the same, rad."""
_STILL = 1e-3
"""Moves below this say nothing about the direction of approach, mm."""
_OPERATING_ROLES = ("load", "speed")


def repeat_groups(
    campaign: Campaign, machine: Machine | None = None, *, both_ways: bool = False
) -> I64:
    """Number the groups of repeated rows.

    Repeats agree in run, set-up, kind, positions, approach directions, tool, spindle angle, unit
    vector and base points. Where the campaign records no direction of an axis it follows from the
    order of the rows. With a machine, signals of role load or speed must agree as well (loads
    within 2 % of their range, speeds within 2 % of the greatest: one that was seen and not
    commanded scatters): with another load on the table it is another measurement. Temperatures need
    not agree: the repeats must be close in time instead.

    Parameters
    ----------
    both_ways
        Leave the approach directions out.

    Returns
    -------
    Shape (n,): group number, or −1 for a row that was measured once.
    """
    keys = _keys(campaign, machine)
    if not both_ways:
        keys += _directions(campaign)
    varying = [key for key in keys if campaign.n and (key != key[0]).any()]
    if not varying:
        return np.zeros(campaign.n, dtype=np.int64) if campaign.n > 1 else np.full(campaign.n, -1)
    order = np.lexsort(varying)
    new = np.zeros(campaign.n, dtype=np.bool_)
    for key in varying:
        new[1:] |= key[order][1:] != key[order][:-1]
    number = np.cumsum(new)
    repeated = np.bincount(number) > 1
    kept = np.where(repeated, np.cumsum(repeated) - 1, -1)
    groups = np.empty(campaign.n, dtype=np.int64)
    groups[order] = kept[number]
    return groups


def _keys(campaign: Campaign, machine: Machine | None) -> list[I64]:
    c = campaign.conditions
    keys = [campaign.kind.astype(np.int64)]
    keys += [] if c.run is None else [c.run]
    for names in (c.setup, c.base, campaign.base2, campaign.tool_name):
        if names is not None:
            keys.append(np.unique(names, return_inverse=True)[1].reshape(-1).astype(np.int64))
    keys += [
        _rounded(q, SAME_ANGLE if is_rotary(a) else SAME_POSITION) for a, q in c.positions.items()
    ]
    keys += [_rounded(c.tool[:, i], SAME_POSITION) for i in range(3)]
    if c.u is not None:
        keys += [_rounded(c.u[:, i], 1e-6) for i in range(3)]
    if c.spindle_angle is not None:
        keys.append(_rounded(c.spindle_angle, SAME_ANGLE))
    for name, signal in c.signals.items() if machine else ():
        declared = machine.signals.get(name) if machine else None
        if declared is not None and declared.role in _OPERATING_ROLES and np.ptp(signal) > 0.0:
            span = np.abs(signal).max() if declared.role == "speed" else np.ptp(signal)
            keys.append(_rounded(signal, 0.02 * float(span)))
    return keys


def _rounded(values: F64, step: float) -> I64:
    return np.rint(values / step).astype(np.int64)


def _directions(campaign: Campaign) -> list[I64]:
    return [approach(campaign, axis) for axis in campaign.conditions.positions]


def approach(campaign: Campaign, axis: str) -> I64:
    """Direction (1, −1; 0 unknown) in which an axis approached each row, shape (n,).

    As recorded; where the campaign has no such column, from the order of the rows in time, unknown
    where the rows have no times. A position read several times belongs to the move that led there;
    where the axis turns round there, the later half of the readings belongs to the move that leads
    away, as in the test cycle of ISO 230-2, which passes the end and comes back to it.
    """
    c = campaign.conditions
    if axis in c.directions:
        return c.directions[axis].astype(np.int64)
    if not campaign.clocked:
        return np.zeros(c.n, dtype=np.int64)
    run = np.zeros(c.n, dtype=np.int64) if c.run is None else c.run
    order = np.lexsort((np.arange(c.n), c.time, run))
    q, r = c.positions[axis][order], run[order]
    moved = np.abs(np.diff(q)) > _STILL
    starts = np.flatnonzero(np.r_[True, moved | (np.diff(r) != 0)])
    lengths = np.diff(np.r_[starts, c.n])
    stay = np.repeat(np.arange(len(starts)), lengths)
    step = np.sign(np.diff(q[starts])).astype(np.int64)
    step[np.diff(r[starts]) != 0] = 0
    before, after = np.r_[0, step], np.r_[step, 0]
    before, after = np.where(before == 0, after, before), np.where(after == 0, before, after)
    later = np.arange(c.n) - starts[stay] >= (lengths[stay] + 1) // 2
    direction = np.empty(c.n, dtype=np.int64)
    direction[order] = np.where(later, after[stay], before[stay])
    return direction
