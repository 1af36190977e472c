"""What a shop does in a spreadsheet: a straight linear regression on all that was recorded.

Nothing of a machine is known here but the names of its columns: no chain, no lever, no effect. Each
measured component by itself, ordinary least squares (LINEST) on positions, of rotary axes sine and
cosine, signals, and the direction of approach.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign

F64 = NDArray[np.float64]
Rows = NDArray[np.int64]

SETTINGS = (
    "*Spreadsheet*: each measured component by itself, ordinary least squares (LINEST) on a "
    "constant, positions (of rotary axes sine and cosine), signals and directions of approach; "
    "where a set-up's zero is unknown, it is taken from the held-out rows, as Abbe does"
)

_FEW = 6
"""So many directions are measured one by one; of more, a place's first reading is one component,
its second another, as a telescope's two."""


def regressed(seen: Campaign, unseen: Campaign) -> F64:
    """What a regression on one campaign leaves of another, (n,), mm or rad.

    Where the zero of a set-up is unknown it is taken from the rows of the other campaign.
    """
    left = _left(seen, _components(seen), unseen, _components(unseen))
    for rows in _setups(unseen):
        _take_zero(left, unseen, rows)
    return left


def left_out(campaign: Campaign, blocks: Sequence[Rows]) -> F64:
    """What a regression on all other rows leaves of each block, (n,), mm or rad.

    A set-up that lies in the block as a whole has its zero taken from there.
    """
    left = campaign.value.copy()
    what = _components(campaign)
    for block in blocks:
        others = np.setdiff1d(np.arange(campaign.n), block)
        left[block] = _left(campaign.rows(others), what[others], campaign.rows(block), what[block])
        for rows in _setups(campaign):
            if np.isin(rows, block).all():
                _take_zero(left, campaign, rows)
    return left


def rms(left: F64) -> float:
    """Root mean square."""
    return math.sqrt(float(np.mean(left**2)))


def _left(seen: Campaign, mine: Rows, unseen: Campaign, others: Rows) -> F64:
    left = np.empty(unseen.n)
    here, there = _columns(seen), _columns(unseen)
    names = [name for name in here if np.ptp(here[name]) > 0.0]
    for component in np.unique(others):
        rows, later = mine == component, others == component
        a = np.column_stack([np.ones(rows.sum()), *(here[name][rows] for name in names)])
        b = np.column_stack([np.ones(later.sum()), *(there[name][later] for name in names)])
        size = np.abs(a).max(axis=0)
        size[size == 0.0] = 1.0
        found = np.linalg.lstsq(a / size, seen.value[rows], rcond=1e-10)[0] / size
        left[later] = unseen.value[later] - b @ found
    return left


def _columns(campaign: Campaign) -> dict[str, F64]:
    conditions = campaign.conditions
    found: dict[str, F64] = {}
    for axis, position in conditions.positions.items():
        if axis[0] in "ABC":
            found[f"sin {axis}"], found[f"cos {axis}"] = np.sin(position), np.cos(position)
        else:
            found[axis] = position
        found[f"{axis} direction"] = conditions.direction(axis)
    return found | dict(conditions.signals)


def _components(campaign: Campaign) -> Rows:
    """A number for what each row measured, (n,)."""
    conditions = campaign.conditions
    if conditions.u is None:
        return np.zeros(campaign.n, dtype=np.int64)
    along = np.unique(np.round(conditions.u, 2), axis=0, return_inverse=True)[1].reshape(-1)
    if along.max() < _FEW:
        return np.asarray(along)
    places = np.column_stack([conditions.time, *conditions.positions.values()])
    moved = np.any(np.diff(places, axis=0) != 0.0, axis=1)
    first = np.concatenate([[0], np.flatnonzero(moved) + 1])
    return np.arange(campaign.n) - first[np.cumsum(np.concatenate([[False], moved]))]


def _setups(campaign: Campaign) -> Iterator[Rows]:
    """The rows of each set-up whose zero is unknown."""
    names = campaign.conditions.setup
    for name, setup in campaign.setups.items():
        if names is not None and "zero" in setup.free:
            yield np.flatnonzero(names == name)


def _take_zero(left: F64, campaign: Campaign, rows: Rows) -> None:
    components = _components(campaign)[rows]
    for component in np.unique(components):
        own = rows[components == component]
        left[own] -= left[own].mean()
