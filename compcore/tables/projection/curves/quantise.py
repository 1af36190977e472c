"""Quantisation of table values to a controller's resolution and range, without bias."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.tables.projection.curves.hats import node_weights

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


def rounded(values: F64, step: float, weights: F64, fixed: NDArray[np.bool_] | None = None) -> I64:
    """Values in whole steps of the resolution, the mean error of interpolation near zero.

    Each value is rounded to the nearest step; then, as long as that brings the weighted mean of the
    rounding errors nearer to zero, the value whose rounding was nearest to a half is rounded the
    other way. No entry is off by more than one step, nearly all by half a step at most.

    Parameters
    ----------
    values
        (n,), in the unit of `step`.
    step
        Least increment step, > 0.
    weights
        (n,): share of each entry in the mean, the integral of its hat.
    fixed
        (n,): entries that must be rounded to the nearest step.
    """
    ideal = values / step
    whole = np.rint(ideal)
    error = whole - ideal
    share = weights / weights.sum()
    bias = float(error @ share)
    free = np.ones(len(values), dtype=bool) if fixed is None else ~fixed
    # nearest to a half first: rounding those the other way costs least
    order = np.argsort(-np.abs(error), kind="stable")
    before = np.inf
    while abs(bias) < before:
        before = abs(bias)
        for i in order:
            turned = -np.sign(error[i])
            if free[i] and error[i] * bias > 0.0 and abs(bias + turned * share[i]) < abs(bias):
                whole[i] += turned
                error[i] += turned
                bias += turned * float(share[i])
    return whole.astype(np.int64)


def slope_limited(values: I64, limit: int) -> I64:
    """The nearest entries of which no two neighbours differ by more than a limit.

    Nearest in the greatest difference: the mean of the least limited function above and the
    greatest below (McShane, Bull. AMS 40 (1934), for real values; its floor keeps the limit for
    whole ones). Where the limit is kept already nothing changes.
    """
    above, below = values.copy(), values.copy()
    for i in range(1, len(values)):
        above[i] = max(above[i], above[i - 1] - limit)
        below[i] = min(below[i], below[i - 1] + limit)
    for i in range(len(values) - 2, -1, -1):
        above[i] = max(above[i], above[i + 1] - limit)
        below[i] = min(below[i], below[i + 1] + limit)
    return np.asarray((above + below) // 2)


@dataclass(frozen=True)
class QuantisedValues:
    """Table values in whole steps of the resolution, and what limited them.

    Attributes
    ----------
    values
        (n,), whole multiples of `step`, mm or rad.
    step
        Step that was used, mm or rad.
    limited
        Largest distance from the wanted values that a range forced, mm or rad; 0: none did.
    """

    values: F64
    step: float
    limited: float = 0.0


def quantise(
    values: F64,
    nodes: F64,
    step: float,
    *,
    value_range: tuple[float, float] | None = None,
    increment_limit: int | None = None,
    zero: int | None = None,
) -> QuantisedValues:
    """Values at nodes as a controller can store them.

    Parameters
    ----------
    values, nodes
        (n,), mm or rad.
    step
        Least increment step in the values' unit; 0: no rounding.
    value_range
        Least and greatest value, in the values' unit.
    increment_limit
        Most steps from one entry to the next.
    zero
        Index of an entry that is 0 and must stay so.
    """
    fixed = None
    if zero is not None:
        fixed = np.zeros(len(values), dtype=bool)
        fixed[zero] = True
    kept = values if value_range is None else np.clip(values, *value_range)
    limited = float(np.abs(kept - values).max())
    if step <= 0.0:
        return QuantisedValues(kept, step, limited)
    whole = rounded(kept, step, node_weights(nodes), fixed)
    if value_range is not None:
        low, high = np.ceil(value_range[0] / step - 1e-9), np.floor(value_range[1] / step + 1e-9)
        whole = np.clip(whole, int(low), int(high))
    if increment_limit is not None:
        reachable = whole
        if zero is not None:
            far = increment_limit * np.abs(np.arange(len(whole)) - zero)
            reachable = np.clip(whole, -far, far)
        within = slope_limited(reachable, increment_limit)
        if (within != whole).any():
            limited = max(limited, float(np.abs(within * step - values).max()))
        whole = within
    return QuantisedValues(np.asarray(whole * step, dtype=np.float64), step, limited)
