"""Places of a set-up that were read again: whether their visits, or other places, judge an effect.

A table with a value at every target can be judged by another visit alone: what stands at a target
no other one says. So ISO 230-2 judges an axis. Poses of an arm or a grid over a table say of each
axis several times the same, and there a place that was read three times at standstill says no more
than one that was read once: what the model lacks, all three hold alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions

Index = NDArray[np.int64]
F64 = NDArray[np.float64]

_AGAIN = 3
"""Visits of every place from which on they are left out in place of the places: two may be one part
that was measured twice."""

_STEPS = 10
"""Places along an axis that are told apart where it is asked if tables would go through all."""

_DECIMALS = 2
"""Of mm, and of rad ten times finer: what a machine that returns to a place does not repeat."""


def places(conditions: Conditions) -> Index:
    """The place of each row: its positions, side of approach, tool and measured component."""
    c = conditions
    measured = np.zeros((c.n, 4))
    if c.u is not None:
        measured[:, :3] = c.u
    if c.kind is not None:
        measured[:, 3] = c.kind
    shown = (*c.positions.values(), *c.directions.values(), *measured.T, *c.tool.T)
    rounded = np.round(np.column_stack(shown), _DECIMALS)
    return np.unique(rounded, axis=0, return_inverse=True)[1].reshape(-1)


def visits(conditions: Conditions, rows: Index) -> list[Index]:
    """First visits of all places of a set-up, second visits and so on, where these judge.

    Empty where a place was visited once or twice, and where other places judge.
    """
    c = conditions.rows(rows)
    if not tables_fit_all(c):
        return []
    place = places(c)
    count = np.bincount(place)
    if len(count) < 2 or count.min() < _AGAIN:
        return []
    by_place = np.argsort(place, kind="stable")
    visit = np.empty(c.n, dtype=np.int64)
    visit[by_place] = np.arange(c.n) - np.repeat(np.cumsum(count) - count, count)
    return [rows[visit == k] for k in range(int(count.max()))]


def tables_fit_all(conditions: Conditions) -> bool:
    """Whether a table for each axis would go through all places, whatever was measured there.

    So along a line, or a line of each axis. Of a grid, or of poses of an arm, each position of an
    axis is seen with several of the others.
    """
    moved = [v for v in conditions.positions.values() if np.ptp(v) > 0.0]
    if len(moved) < 2:
        return True
    steps = [np.floor((v - v.min()) / np.ptp(v) * _STEPS).clip(max=_STEPS - 1) for v in moved]
    cells = np.unique(np.column_stack(steps), axis=0)
    tables = np.hstack([p[:, None] == np.arange(_STEPS) for p in cells.T]).astype(float)
    return int(np.linalg.matrix_rank(tables)) == len(cells)


def rows_that_say_more(residual: F64, conditions: Conditions) -> float:
    """What rows of a set-up count for, where other places judge: of a place as far as they differ.

    Of n rows of a place whose residuals are correlated by ρ (over all places), ``n/(1+(n-1)·ρ)``.
    """
    if tables_fit_all(conditions):
        return float(len(residual))
    place = places(conditions)
    count = np.bincount(place)
    squares = np.bincount(place, residual**2)
    together = float(np.sum(np.bincount(place, residual) ** 2 - squares))
    apart = float(np.sum((count - 1) * squares))
    rho = min(1.0, max(0.0, together / apart)) if apart > 0.0 else 0.0
    return float(np.sum(count / (1.0 + (count - 1) * rho)))
