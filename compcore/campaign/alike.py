"""Rows of one name, of all names in one go: a look at every row for each name is quadratic."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def alike(names: NDArray[np.generic]) -> list[NDArray[np.int64]]:
    """Rows (n,) of each name, ascending, in the order of the sorted names."""
    if not len(names):
        return []
    order = np.argsort(names, kind="stable")
    ordered = names[order]
    parts: list[NDArray[np.int64]] = np.split(
        order, np.flatnonzero(ordered[1:] != ordered[:-1]) + 1
    )
    return parts
