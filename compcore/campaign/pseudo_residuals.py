"""Combinations of repeated readings in which even drift drops out.

Each repeat against the straight line in time through its neighbours (pseudo-residuals; Gasser,
Sroka, Jennen-Steinmetz, Biometrika 73, 1986, 625), scaled to the variance of one reading.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

TRIPLE_SPAN = 3600.0
"""Three repeats count when they lie within this, s."""
PAIR_SPAN = 600.0
"""Two repeats alone (no line through neighbours: drift stays in) count within this, s."""


@dataclass(frozen=True)
class Differences:
    """Pseudo-residuals: combinations of repeats in which even drift drops out, each of variance 1.

    Each takes the values of a few readings, (m, 2) or (m, 3) of them, times as many weights, whose
    squares add up to 1; no reading stands twice in one column. `middle` (m,) is the row each is
    about.
    """

    readings: I64
    weights: F64
    middle: I64

    def of(self, values: F64) -> F64:
        """The pseudo-residuals of values (n,), shape (m,)."""
        return np.asarray((self.weights * values[self.readings]).sum(axis=1))

    def keep(self, rows: NDArray[np.bool_]) -> Differences:
        """Some of them."""
        return Differences(self.readings[rows], self.weights[rows], self.middle[rows])

    @property
    def count(self) -> int:
        """How many."""
        return len(self.middle)

    @property
    def degrees_of_freedom(self) -> float:
        """Satterthwaite's: overlapping differences share readings and count less than they are."""
        if not self.count:
            return 0.0
        return self.count**2 / (self.count + 2.0 * self._shared())

    def _shared(self) -> float:
        """Σ of the squares of the inner products of any two."""
        n = int(self.readings.max()) + 1
        pairs_of: list[I64] = []
        products: list[F64] = []
        for one, other in combinations(range(self.readings.shape[1]), 2):
            # which difference has a reading in the other column
            there = np.full(n, -1)
            there[self.readings[:, other]] = np.arange(self.count)
            second = there[self.readings[:, one]]
            first = np.flatnonzero(second >= 0)
            second = second[first]
            pairs_of.append(np.minimum(first, second) * self.count + np.maximum(first, second))
            products.append(self.weights[first, one] * self.weights[second, other])
        _, which = np.unique(np.concatenate(pairs_of), return_inverse=True)
        inner = np.bincount(which.reshape(-1), np.concatenate(products))
        return float(inner @ inner)


def in_time(groups: I64, time: F64) -> I64:
    """Rows of repeats, group by group, in the order of time."""
    order = np.lexsort((np.arange(len(time)), time, groups))
    return order[groups[order] >= 0]


def triples(groups: I64, time: F64, step: int) -> Differences:
    """Each repeat against the line through the ones `step` before and after it.

    `groups` (n,) as `repeat_groups` numbers them, `time` (n,) in s.
    """
    order = in_time(groups, time)
    a, b, c = order[: -2 * step], order[step:-step], order[2 * step :]
    close = (groups[a] == groups[c]) & (time[c] - time[a] <= step * TRIPLE_SPAN)
    a, b, c = a[close], b[close], c[close]
    span = time[c] - time[a]
    at = np.where(span > 0.0, (time[b] - time[a]) / np.where(span > 0.0, span, 1.0), 0.5)
    norm = np.sqrt((1.0 - at) ** 2 + at**2 + 1.0)
    weights = np.stack([(1.0 - at) / norm, -1.0 / norm, at / norm], axis=1)
    return Differences(np.stack([a, b, c], axis=1), weights, b)


def pairs(groups: I64, time: F64) -> Differences:
    """Each repeat against the one before it; as `triples`, but drift stays in."""
    order = in_time(groups, time)
    a, b = order[:-1], order[1:]
    close = (groups[a] == groups[b]) & (time[b] - time[a] <= PAIR_SPAN)
    index = np.stack([a[close], b[close]], axis=1)
    weights = np.tile([-np.sqrt(0.5), np.sqrt(0.5)], (len(index), 1))
    return Differences(index, weights, b[close])
