"""Distinct values among numbers, and distinct functions among sampled ones.

Without ``np.unique``, which imports masked arrays: 30 ms of every start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

_SAME = 9
"""Decimals: functions in mm (or mm per unit) alike to a millionth of a micrometre are the same."""


def increasing(values: F64) -> F64:
    """Values (n,) in order, each once."""
    ordered = np.sort(values)
    return np.asarray(ordered[np.append(True, np.diff(ordered) > 0.0)])


def distinct(rows: F64) -> list[int]:
    """Index of the first of each of those rows that differ, rows of shape (n, …)."""
    rounded = np.round(rows, _SAME) + 0.0
    first: dict[bytes, int] = {}
    for i, row in enumerate(rounded):
        first.setdefault(row.tobytes(), i)
    return list(first.values())
