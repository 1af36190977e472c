"""A function of several variables as a sum of products of functions of one variable each.

Cross (skeleton) interpolation: with pivots x_i of the first variable and y_j of the others,
``f(x, y) ≈ Σ_ij f(x, y_j)·(M⁻¹)_ji·f(x_i, y)``, ``M_ij = f(x_i, y_j)``; exact where f has the rank
of the pivots. The pivots are chosen once; a refold evaluates f along a few lines only. Functions of
more than two variables: ``f(x_i, ·)`` in turn. (Bebendorf, Numer. Math. 86 (2000), adaptive cross
approximation; here with full pivoting on a coarse grid.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Function = Callable[[F64], F64]
"""Rows (n, d) → values in each of several states, (states, n)."""

_HIGHEST_RANK = 12
_SINGULAR = 1e-9


class NotSeparableError(Exception):
    """No short sum of products comes close enough."""


@dataclass(frozen=True, eq=False)
class Cross:
    """The pivots of a cross interpolation.

    Attributes
    ----------
    first
        Pivots of the first variable, shape (r,).
    rest
        Pivots of the others, shape (r, d − 1).
    inner
        With more than two variables: the cross of ``f(first[i], ·)``, one for each i.
    """

    first: F64
    rest: F64
    inner: tuple[Cross, ...] = ()

    def rows(self, nodes: Sequence[F64]) -> F64:
        """Where f has to be known, (n, d), given the nodes of each variable's tables."""
        r = len(self.first)
        lines = np.concatenate([_joined(nodes[0][:, None], self.rest[j]) for j in range(r)])
        pivots = np.concatenate([_joined(self.first[:, None], self.rest[j]) for j in range(r)])
        if self.inner:
            ends = [cross.rows(nodes[1:]) for cross in self.inner]
        else:
            ends = [nodes[1][:, None]] * r
        beyond = [
            np.column_stack([np.full(len(end), x), end])
            for x, end in zip(self.first, ends, strict=True)
        ]
        return np.concatenate([lines, pivots, *beyond])

    def products(self, values: F64, nodes: Sequence[F64]) -> list[list[F64]]:
        """Products of tables, one table for each variable, from f at `rows`, shape (n,)."""
        return self._take(list(nodes), _Tape(values))

    def _take(self, nodes: Sequence[F64], tape: _Tape) -> list[list[F64]]:
        r = len(self.first)
        lines = tape.take(r * len(nodes[0])).reshape(r, -1).T
        pivots = tape.take(r * r).reshape(r, r).T
        left = lines @ _inverse(pivots)
        if not self.inner:
            return [[left[:, i], tape.take(len(nodes[1]))] for i in range(r)]
        return [
            [left[:, i], *product]
            for i, cross in enumerate(self.inner)
            for product in cross._take(nodes[1:], tape)
        ]


class _Tape:
    """Values taken off in the order in which their rows were laid out."""

    def __init__(self, values: F64) -> None:
        self._values, self._at = values, 0

    def take(self, count: int) -> F64:
        self._at += count
        return self._values[self._at - count : self._at]


def find_cross(function: Function, grids: Sequence[F64], tolerance: float) -> Cross | None:
    """Pivots with which `function` is met to within `tolerance` in every state; None where it is 0.

    Parameters
    ----------
    grids
        Coarse positions of each variable on which pivots are sought.
    tolerance
        In the function's own unit.

    Raises
    ------
    NotSeparableError
        When the rank is too high.
    """
    rest = _grid(grids[1:])
    every = np.concatenate([_joined(np.full((len(rest), 1), x), rest) for x in grids[0]])
    table = function(every).reshape(-1, len(grids[0]), len(rest))
    rows: list[int] = []
    columns: list[int] = []
    left = table
    while np.abs(left).max() > tolerance:
        if len(rows) == _HIGHEST_RANK:
            raise NotSeparableError
        _, i, j = (int(k) for k in np.unravel_index(np.abs(left).argmax(), left.shape))
        rows.append(i)
        columns.append(j)
        pivots = np.stack([_inverse(state[rows][:, columns]) for state in table])
        left = table - table[:, :, columns] @ pivots @ table[:, rows]
    if not rows:
        return None
    first = np.asarray(grids[0], dtype=np.float64)[rows]
    inner: list[Cross] = []
    if len(grids) > 2:
        for x in first:
            part = find_cross(_given(function, float(x)), grids[1:], tolerance / (2 * len(rows)))
            if part is None:
                raise AssertionError("a pivot stands where the function is not 0")
            inner.append(part)
    return Cross(first, rest[columns], tuple(inner))


def _inverse(pivots: F64) -> F64:
    """The pseudo-inverse: in a state in which the function vanishes, so do its products."""
    if len(pivots) == 1:
        return np.where(pivots == 0.0, 0.0, 1.0 / np.where(pivots == 0.0, 1.0, pivots))
    return np.asarray(np.linalg.pinv(pivots, rcond=_SINGULAR))


def _given(function: Function, x: float) -> Function:
    def rest(rows: F64) -> F64:
        return function(np.column_stack([np.full(len(rows), x), rows]))

    return rest


def _grid(grids: Sequence[F64]) -> F64:
    return np.stack([g.reshape(-1) for g in np.meshgrid(*grids, indexing="ij")], axis=1)


def _joined(first: F64, rest: F64) -> F64:
    """Columns of first (n, 1) and rest (m,) or (n, m) side by side, (n, 1 + m)."""
    if rest.ndim == 1:
        rest = np.broadcast_to(rest, (len(first), len(rest)))
    return np.concatenate([first, rest], axis=1)
