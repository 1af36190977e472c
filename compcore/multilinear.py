"""Values between the points of a grid of one to three dimensions: straight lines, the ends held."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Index = NDArray[np.intp]


def interpolate(nodes: Sequence[F64], values: F64, positions: Sequence[F64]) -> F64:
    """Multilinear interpolation at n positions, (n,) for each dimension; the ends are held."""
    if len(nodes) == 1:
        return np.interp(positions[0], nodes[0], values)
    return weighted(corners(nodes, positions), values)


def corners(nodes: Sequence[F64], positions: Sequence[F64]) -> list[tuple[tuple[Index, ...], F64]]:
    """The corners of the cells in which n positions lie, and the part of each in the value there.

    Parameters
    ----------
    nodes
        Strictly increasing, one array for each dimension.
    positions
        Shape (n,) for each dimension; beyond the ends they count as at the ends.

    Returns
    -------
    For each of the 2^d corners its indices, (n,) a dimension, and its weight, (n,); the weights of
    a position add up to 1.
    """
    left, part = [], []
    for grid, position in zip(nodes, positions, strict=True):
        held = np.clip(position, grid[0], grid[-1])
        index = np.clip(np.searchsorted(grid, held, side="right") - 1, 0, max(len(grid) - 2, 0))
        span = grid[np.minimum(index + 1, len(grid) - 1)] - grid[index]
        left.append(index)
        part.append((held - grid[index]) / np.where(span > 0.0, span, 1.0))
    found = []
    for corner in itertools.product((0, 1), repeat=len(nodes)):
        weight = np.ones(len(positions[0]))
        at = []
        for k, (i, w) in enumerate(zip(left, part, strict=True)):
            weight = weight * (w if corner[k] else 1.0 - w)
            at.append(np.minimum(i + corner[k], len(nodes[k]) - 1))
        found.append((tuple(at), weight))
    return found


def weighted(cells: Sequence[tuple[tuple[Index, ...], F64]], values: F64) -> F64:
    """What values on a grid are at the positions of `corners`.

    Values of shape (…), the grid's, give (n,); several at each point, (…, k), give (n, k).
    """
    several = values.ndim > len(cells[0][0])
    return np.asarray(
        sum((weight[:, None] if several else weight) * values[at] for at, weight in cells)
    )
