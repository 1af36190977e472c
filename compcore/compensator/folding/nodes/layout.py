"""Node placement: where a piecewise linear table needs nodes to keep its tolerance."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.nodes.distinct import distinct, increasing

F64 = NDArray[np.float64]
Profile = Callable[[F64], F64]
"""Positions (m,) → (m, w, f): f functions of position with w components in mm."""
Size = Callable[[F64], F64]

_CELLS = 512
_FEWEST = 4
_INSIDE = np.array([0.25, 0.5, 0.75])
"""Where interpolation within a cell is checked; the middle also by every refold."""
_EACH = len(_INSIDE) + 1
_JUMP = 1e-9
"""A cell this small, as a part of the whole range, stands for a jump and is not split again."""


class TooManyNodesError(Exception):
    """The functions need more nodes than a table may have."""


class SampledFunctions:
    """Samples of some functions of one position, from which nodes are chosen.

    The samples stand on a dyadic grid between the breaks and inside each of its cells; a little off
    the quarters, so that a period equal to the grid's does not go unseen.

    Parameters
    ----------
    profile
        The functions; the worst of them counts.
    size
        The size in mm of errors with w components, (…, w, f) → (…, f).
    breaks
        Positions where a slope may jump, the ends of the range included; always nodes.
    """

    def __init__(self, profile: Profile, size: Size, breaks: Sequence[float]) -> None:
        self._profile, self._size = profile, size
        self.breaks = increasing(np.asarray(breaks, dtype=np.float64))
        lengths = np.diff(self.breaks)
        share = np.maximum(_FEWEST, _CELLS * lengths / lengths.sum())
        cells = 2 ** np.ceil(np.log2(share)).astype(np.int64)
        grid = [
            a + (b - a) * np.arange(n) / n
            for a, b, n in zip(self.breaks[:-1], self.breaks[1:], cells, strict=True)
        ]
        at = np.concatenate([*grid, self.breaks[-1:]])
        rng = np.random.default_rng(8)
        parts = np.tile(np.append(0.0, _INSIDE), (len(at) - 1, 1))
        parts[:, [1, 3]] += rng.uniform(-0.05, 0.05, (len(at) - 1, 2))
        between = at[:-1, None] + np.diff(at)[:, None] * parts
        self._x = np.append(between.reshape(-1), at[-1])
        self._ends = np.concatenate([[0], np.cumsum(_EACH * cells)])
        values = profile(self._x)
        bent = values - self._straight(values)
        # functions that differ by straight lines only are one and the same to a table
        self._kept = distinct(np.moveaxis(bent, 2, 0))
        self._bent = bent[:, :, self._kept]
        self.off = float(self._size(self._bent).max())
        """How far off, in mm, a table with nodes at the breaks only is."""

    def _straight(self, values: F64) -> F64:
        """The straight lines between the breaks, in the place of all samples."""
        at_breaks = values[self._ends].reshape(len(self.breaks), -1)
        lines = [np.interp(self._x, self.breaks, column) for column in at_breaks.T]
        return np.stack(lines, axis=1).reshape(values.shape)

    def nodes(self, tolerance: float, most: int) -> F64:
        """Nodes such that interpolation is nowhere off by more than `tolerance` mm.

        Raises
        ------
        TooManyNodesError
            When more than `most` would be needed.
        """
        found = [self.breaks]
        small = []
        for first, last in zip(self._ends[:-1].tolist(), self._ends[1:].tolist(), strict=True):
            step = last - first
            left = np.array([first])
            while left.size:
                left = left[self._worse(left, step, tolerance)]
                if step == _EACH:
                    small.append(np.stack([self._x[left], self._x[left + step]], axis=1))
                    break
                step //= 2
                found.append(self._x[left + step])
                left = np.concatenate([left, left + step])
        if small:
            found.append(self._split(np.concatenate(small), tolerance, most))
        nodes = increasing(np.concatenate(found))
        if len(nodes) > most:
            raise TooManyNodesError
        return nodes

    def _worse(self, left: NDArray[np.int64], step: int, tolerance: float) -> NDArray[np.bool_]:
        """Whether interpolation over `step` samples from each of `left` is off by more, (cells,).

        While nodes are few the middle sample shows it; the others are looked at where it does not.
        """
        v = self._bent
        middle = v[left + step // 2] - 0.5 * (v[left] + v[left + step])
        worse = np.asarray(self._size(middle).max(axis=-1) > tolerance)
        close = np.flatnonzero(~worse)
        worse[close] = self._off(left[close], step) > tolerance
        return worse

    def _off(self, left: NDArray[np.int64], step: int) -> F64:
        """How far off interpolation over `step` samples from each of `left` is, (cells,)."""
        rows = left[:, None] + np.arange(step + 1)
        x, v = self._x[rows], self._bent[rows]
        part = (x[:, 1:-1] - x[:, :1]) / (x[:, -1:] - x[:, :1])
        line = v[:, :1] + part[:, :, None, None] * (v[:, -1:] - v[:, :1])
        return np.asarray(self._size(v[:, 1:-1] - line).max(axis=(1, 2)))

    def _split(self, cells: F64, tolerance: float, most: int) -> F64:
        """Split cells, shape (c, 2), until interpolation within each is good; the new nodes."""
        least = _JUMP * (self.breaks[-1] - self.breaks[0])
        found: list[F64] = [np.empty(0)]
        count = 0
        while len(cells):
            low, high = cells[:, 0], cells[:, 1]
            middle = 0.5 * (low + high)
            found.append(middle)
            count += len(cells)
            if count > most:
                raise TooManyNodesError
            halves = np.concatenate([np.stack([low, middle], 1), np.stack([middle, high], 1)])
            off = self._cells_off(halves)
            cells = halves[(off > tolerance) & (halves[:, 1] - halves[:, 0] > least)]
        return np.concatenate(found)

    def _cells_off(self, cells: F64) -> F64:
        low, high = cells[:, :1], cells[:, 1:]
        x = np.concatenate([low, low + _INSIDE * (high - low), high], axis=1)
        values = self._profile(x.reshape(-1))[:, :, self._kept]
        v = values.reshape(*x.shape, *values.shape[1:])
        line = v[:, :1] + _INSIDE[:, None, None] * (v[:, -1:] - v[:, :1])
        return np.asarray(self._size(v[:, 1:-1] - line).max(axis=(1, 2)))
