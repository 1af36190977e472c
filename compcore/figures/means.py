"""The line of means through a cloud of residuals, where it says more than chance does.

Over random poses of an arm the means of parts go up and down as the other joints happen to stand: a
zigzag that looks like a finding. The browser draws few rows by the same rule
(``static/residuals/means.js``).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

_ABOVE = 5.0
"""Standard deviations of chance by which means have to differ more than it makes them."""
_LEAN = 4.0
"""Rows for which the usual scatter counts."""
_NOTHING = 1e-12
"""µm² or µrad²: readings that are all the same."""
_FEWEST = 6
"""Rows more than parts, from which on the scatter within the parts is known."""


def mean_line(x: F64, y: F64, part: Index, parts: int) -> list[tuple[float, float]]:
    """What lies across and the mean, part by part; one level where only that is seen; or nothing.

    Parameters
    ----------
    x, y
        What lies across and residuals, (n,).
    part
        The part of each row, (n,), below `parts`.
    """
    n = np.bincount(part, minlength=parts)
    has = n > 0
    at, mean = (np.bincount(part, v, minlength=parts)[has] / n[has] for v in (x, y))
    line = list(zip(at.tolist(), mean.tolist(), strict=True))
    k, free = len(line), len(x) - len(line)
    if k < 2 or free < _FEWEST:
        return line
    rows = n[has]
    inside = np.bincount(part, (y - (mean[np.cumsum(has) - 1])[part]) ** 2, minlength=parts)[has]
    # lines read at one place of this axis scatter less than poses all over: each part for itself,
    # those of few rows leaning on the usual part
    usual = float(np.median(inside[rows > 1] / (rows[rows > 1] - 1.0)))
    square = (inside + _LEAN * usual) / (rows - 1.0 + _LEAN) + _NOTHING
    weight = rows / square
    level = float(weight @ mean / weight.sum())
    if float(weight @ (mean - level) ** 2) > k - 1 + _ABOVE * np.sqrt(2.0 * (k - 1)):
        return line
    if level**2 * float(weight.sum()) > _ABOVE**2:
        return [(line[0][0], level), (line[-1][0], level)]
    return []
