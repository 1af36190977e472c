"""A frame: the directions of the rows' space in which some candidates' columns lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.projection.basis import Basis

F64 = NDArray[np.float64]

_ROUNDING = 1e-14
"""Squares below this part of a unit are rounding."""


@dataclass(frozen=True, eq=False)
class Frame:
    """Orthonormal directions of the rows' space, in which some candidates' columns lie.

    Attributes
    ----------
    rows
        The rows in which the directions are not zero, shape (v,), or all.
    model
        What the fitted model can imitate there: ``N Nᵀ`` is the projection on it in the directions'
        coordinates, shape (directions, r).
    number, unit
        For directions that are sums of rows: each row's direction, ascending, and its part in it,
        shape (v,) each. None where each row is a direction of its own.
    count
        Number of directions.
    setups
        What each set-up's nuisances can imitate besides `model`, as it is zero outside their own
        rows: the rows, and an orthonormal basis there, (rows, k).
    """

    rows: NDArray[np.int64] | slice
    model: F64
    count: int
    number: NDArray[np.int64] | None = None
    unit: F64 | None = None
    setups: Sequence[tuple[NDArray[np.int64] | slice, F64]] = ()

    @classmethod
    def whole(cls, fitted: Basis) -> Frame:
        """All rows."""
        n = len(fitted.residual)
        if fitted.eliminator.whitening is not None:
            return cls(slice(None), fitted.imitable, n)
        own = tuple((_span(rows), basis) for rows, basis in fitted.eliminator.bases())
        return cls(slice(None), fitted.q, n, setups=own)

    @classmethod
    def of_rows(cls, fitted: Basis, rows: NDArray[np.int64]) -> Frame:
        """Some of the rows, (v,), ascending."""
        if len(rows) == len(fitted.residual):
            return cls.whole(fitted)
        return cls(_span(rows) if len(rows) else rows, _shorter(fitted.imitable[rows]), len(rows))

    @classmethod
    def of_places(
        cls,
        fitted: Basis,
        rows: NDArray[np.int64],
        number: NDArray[np.int64],
        unit: F64,
        count: int,
    ) -> Frame:
        """Sums of rows; see the attributes."""
        plain = cls(rows, np.zeros((count, 0)), count, number, unit)
        return replace(plain, model=_shorter(plain.of(fitted.imitable)))

    def imitated(self, columns: F64) -> F64:
        """What the fitted model takes of columns that are laid out as rows, (k, directions)."""
        parts = [columns @ self.model]
        parts += [columns[:, rows] @ basis for rows, basis in self.setups]
        return np.hstack(parts) if self.setups else parts[0]

    def of(self, vectors: F64) -> F64:
        """Coordinates of vectors of all rows, (n, k) → (directions, k)."""
        part = vectors[self.rows]
        if self.number is None or self.unit is None:
            return part
        out = np.zeros((self.count, part.shape[1]))
        if len(part):
            starts = np.flatnonzero(np.diff(self.number, prepend=-1))
            out[self.number[starts]] = np.add.reduceat(self.unit[:, None] * part, starts, axis=0)
        return out


@dataclass(frozen=True, eq=False)
class Placed:
    """Columns as coordinates in a frame, (directions, k)."""

    frame: Frame
    values: F64


def _span(rows: NDArray[np.int64]) -> NDArray[np.int64] | slice:
    """Rows as a slice where they follow one another: a view instead of a copy."""
    first, last = int(rows[0]), int(rows[-1])
    return slice(first, last + 1) if last - first == len(rows) - 1 else rows


def _shorter(model: F64) -> F64:
    """A matrix of no more columns than rows with the same ``N Nᵀ``."""
    if model.shape[0] < model.shape[1]:
        values, vectors = np.linalg.eigh(model @ model.T)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
    values, vectors = np.linalg.eigh(model.T @ model)
    return np.asarray(model @ vectors[:, values > _ROUNDING])
