"""Overlap of campaigns: what a test campaign shares with those that the model was fitted to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.alike import alike
from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_DECIMALS = 9
"""Of mm, rad and unit vectors: a file that was written anew still has the same rows."""

SAME_TARGET = 0.1
"""mm within which a machine stands at the same target, as a rule."""
_ALIKE = 0.01
"""By which unit vectors may differ that read alike; of directions and kinds none do so."""
_OUT = 200.0


@dataclass(frozen=True)
class Overlap:
    """What two campaigns share.

    Attributes
    ----------
    rows
        Rows of the second that stand in the first too: same place, value and signals. Rows of the
        first that agree among themselves, as coarse readings of one place do, prove nothing: unless
        most rows stand there once, they are in both only at the same time, where most of those read
        then and there agree; without a clock, only where all are.
    of
        Rows of the second.
    setups
        Set-ups of the second that are in the first too, in order: whose every point was measured
        there (same positions, tool and direction), or that have the name of one that measured the
        same components in the same region (a file that was split in two).
    """

    rows: int
    of: int
    setups: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether the second has no row of its own."""
        return self.rows == self.of


def overlap(fitted: Campaign, unseen: Campaign, near: float = 0.0) -> Overlap:
    """What of a campaign is not new beside another of the same machine.

    Parameters
    ----------
    near
        How far, mm, a machine may stand from a place, or the tool's offset be another, where
        set-ups of the same points are looked for: indicated positions are never twice the same.
        Rotary axes as far as moves a point 200 mm out of their line by so much.
    """
    axes = [a for a in unseen.conditions.positions if a in fitted.conditions.positions]
    points, others = _points(fitted, axes), _points(unseen, axes)
    rows = _rows_in_both(fitted, unseen, points, others)
    known = set(_keys(points))
    again = np.array([k in known for k in _keys(others)], dtype=bool)
    if near > 0.0 and not again.all():
        again |= np.array([len(rows) > 0 for rows in met_again(fitted, unseen, near)])
    setup = unseen.conditions.setup
    parts = [] if setup is None else sorted(alike(setup), key=lambda rows: int(rows[0]))
    named = [("" if setup is None else str(setup[rows[0]]), rows) for rows in parts]
    shared = [n for n, rows in named if again[rows].all() or _same_placing(fitted, unseen, n, axes)]
    return Overlap(rows, unseen.n, tuple(shared))


def _rows_in_both(fitted: Campaign, unseen: Campaign, points: F64, others: F64) -> int:
    one, two = fitted.conditions, unseen.conditions
    signals = sorted(set(one.signals) & set(two.signals))
    read = np.column_stack([points, fitted.value, *(one.signals[s] for s in signals)])
    again = np.column_stack([others, unseen.value, *(two.signals[s] for s in signals)])
    times = Counter(_keys(read))
    at = set(_keys(np.column_stack([read, one.time])))
    rows = list(_keys(again))
    if 2 * sum(times[row] == 1 for row in rows) > len(rows):
        return sum(row in times for row in rows)
    if not (fitted.clocked and unseen.clocked):
        copied = all(count <= times[row] for row, count in Counter(rows).items())
        return len(rows) if copied else 0
    same = sum(moment in at for moment in _keys(np.column_stack([again, two.time])))
    # a run at the same times of its own clock agrees by chance where readings are coarse
    but_for_values = [np.column_stack([p, c.time]) for p, c in ((points, one), (others, two))]
    moments = set(_keys(but_for_values[0]))
    met = sum(moment in moments for moment in _keys(but_for_values[1]))
    return same if 2 * same > met else 0


def _same_placing(fitted: Campaign, unseen: Campaign, name: str, axes: list[str]) -> bool:
    one, two = fitted.conditions.setup, unseen.conditions.setup
    if one is None or two is None or name not in fitted.setups:
        return False
    a, b = fitted.rows(one == name), unseen.rows(two == name)
    for axis in axes:
        p, q = a.conditions.position(axis), b.conditions.position(axis)
        if p.max() < q.min() or q.max() < p.min():
            return False
    return bool(set(_keys(_points(a, []))) & set(_keys(_points(b, []))))


def met_again(fitted: Campaign, unseen: Campaign, near: float, most: int = 1) -> list[I64]:
    """For each row of the second those of the first that were read there in the same way.

    Parameters
    ----------
    near
        As for `overlap`, mm.
    most
        How many rows to name, the nearest ones.

    Returns
    -------
    Of each row the numbers of rows of the first; empty where there are none.
    """
    from scipy.spatial import cKDTree

    axes = [a for a in unseen.conditions.positions if a in fitted.conditions.positions]

    def scaled(campaign: Campaign) -> F64:
        points = _points(campaign, axes)
        size = np.full(points.shape[1], _ALIKE)
        size[[i for i, a in enumerate(axes) if not is_rotary(a)]] = near
        size[[i for i, a in enumerate(axes) if is_rotary(a)]] = near / _OUT
        size[2 * len(axes) : 2 * len(axes) + 3] = near
        return np.asarray(points / size)

    # places read a thousand times stand in the tree once, which cannot part what is equal
    known, of_known = np.unique(scaled(fitted), axis=0, return_inverse=True)
    asked, of_asked = np.unique(scaled(unseen), axis=0, return_inverse=True)
    order = np.argsort(of_known.reshape(-1), kind="stable")
    read = np.split(order, np.cumsum(np.bincount(of_known.reshape(-1)))[:-1])
    _, which = cKDTree(known).query(
        asked, k=np.arange(1, most + 1), p=np.inf, distance_upper_bound=1.0 + 1e-9
    )
    met = [
        np.concatenate([order[:0], *(read[place][:most] for place in own if place < len(read))])
        for own in np.asarray(which)
    ]
    return [met[place][:most] for place in of_asked.reshape(-1)]


def _points(campaign: Campaign, axes: list[str]) -> F64:
    c = campaign.conditions
    u = np.zeros((c.n, 3)) if c.u is None else c.u
    directions = [c.direction(a) for a in axes]
    return np.column_stack(
        [*(c.position(a) for a in axes), *directions, c.tool, u, campaign.kind.astype(np.float64)]
    )


def _keys(table: F64) -> Iterable[bytes]:
    rounded = np.ascontiguousarray(np.round(table, _DECIMALS) + 0.0)
    return (row.tobytes() for row in rounded)
