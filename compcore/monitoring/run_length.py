"""Average run lengths of control charts: how long until a false alarm, how long until a true one.

For charts of independent standard normal values whose mean may have moved. The run length from
each state of the chart obeys a Fredholm integral equation of the second kind, which is solved by
Gauss-Legendre quadrature: Crowder, Journal of Quality Technology 19 (1987), 161, for the EWMA;
Goel and Wu, Technometrics 13 (1971), 221, for the CUSUM.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.linalg import threads_for
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_LONGEST = 1e9
"""Run lengths beyond this are not told apart: the equations' rounding grows with them."""
_NEXT_TO_NONE = 1e-6
_CLOSE = 1e-7
"""Of a run length's logarithm: no chart is known better."""


def ewma_run_length(weight: float, limit: float, shift: float = 0.0) -> float:
    """Average run length of a two-sided EWMA chart that begins at its centre.

    Parameters
    ----------
    weight
        Of the newest value, above 0 and at most 1.
    limit
        In standard deviations that the average has in the long run.
    shift
        Mean of the values, in their standard deviations.

    Returns
    -------
    Number of values until the alarm, that one included.

    Raises
    ------
    ValueError
        For a weight or a limit outside of these ranges.
    """
    if not 0.0 < weight <= 1.0:
        raise ValueError(f"weight {weight}: expected above 0, at most 1")
    _require_limit(limit)
    edge = limit * math.sqrt(weight / (2.0 - weight))
    # the kernel is `weight` wide: some nodes for each width
    nodes, share = _quadrature(-edge, edge, 24 + int(8.0 * edge / weight))
    start = np.append(nodes, 0.0)
    moved = (nodes[None, :] - (1.0 - weight) * start[:, None]) / weight - shift
    return _solved(_density(moved) / weight * share[None, :], len(nodes))


def cusum_run_length(reference: float, limit: float, shift: float = 0.0) -> float:
    """Average run length of a two-sided CUSUM chart that begins at zero.

    Parameters
    ----------
    reference
        What each value must exceed for a sum to grow, in standard deviations; 0 or more. The chart
        is most sensitive to shifts of twice that.
    limit
        Of the sums, in standard deviations.
    shift
        Mean of the values, in their standard deviations.

    Raises
    ------
    ValueError
        For a negative reference or a limit that is not above 0.
    """
    if not 0.0 <= reference < math.inf:
        raise ValueError(f"reference {reference}: expected 0 or more")
    _require_limit(limit)
    # both sums are never near their limits at once: rates of alarm add up (Lucas and Crosier,
    # Technometrics 24 (1982), 199)
    upper = _one_sided(reference - shift, limit)
    lower = _one_sided(reference + shift, limit)
    return 1.0 / (1.0 / upper + 1.0 / lower)


@cache
def ewma_limit(weight: float, run_length: float) -> float:
    """The limit at which an EWMA chart of sound values runs so long until a false alarm."""
    return _where(lambda limit: ewma_run_length(weight, limit), run_length)


@cache
def cusum_limit(reference: float, run_length: float) -> float:
    """The limit at which a CUSUM chart of sound values runs so long until a false alarm."""
    return _where(lambda limit: cusum_run_length(reference, limit), run_length)


def _one_sided(slack: float, limit: float) -> float:
    """Run length of the sum of ``value − slack``, held at 0 or above, from 0."""
    nodes, share = _quadrature(0.0, limit, 24 + int(8.0 * limit))
    # its own equation for the state 0, in which the sum stands with a probability of its own
    start = np.append(nodes, 0.0)
    kernel = np.empty((len(start), len(start)))
    kernel[:, :-1] = _density(nodes[None, :] + slack - start[:, None]) * share[None, :]
    kernel[:, -1] = [_below(slack - u) for u in start.tolist()]
    return _solved(kernel, len(start))


def _solved(kernel: F64, unknowns: int) -> float:
    """The run length from the last state, of ``L = 1 + K L`` on the first `unknowns` states."""
    length = np.linalg.solve(np.eye(unknowns) - kernel[:unknowns], np.ones(unknowns))
    found = 1.0 + float(kernel[-1] @ length)
    return found if 1.0 <= found < _LONGEST else _LONGEST


def _where(length: Callable[[float], float], wanted: float) -> float:
    """The limit at which a run length has a value; by false position in its logarithm."""
    if not 1.0 < wanted <= 1e-2 * _LONGEST:
        raise ValueError(f"run length {wanted}: expected above 1, at most {1e-2 * _LONGEST:g}")
    with threads_for(0):
        shortest = length(_NEXT_TO_NONE)
        if wanted <= shortest:
            raise ValueError(f"run length {wanted}: expected above {in_digits(shortest)}")
        return _root(lambda limit: math.log(length(limit) / wanted))


def _root(rising: Callable[[float], float]) -> float:
    """Where a function rises through zero, above 0; by false position, Illinois's way."""
    low, below, kept = _NEXT_TO_NONE, rising(_NEXT_TO_NONE), 0
    high, above = 1.0, rising(1.0)
    while above < 0.0:
        low, below = high, above
        high += 1.0
        above = rising(high)
    while high - low > _CLOSE:
        middle = low - below * (high - low) / (above - below)
        off = rising(middle)
        if abs(off) < _CLOSE:
            return middle
        # an end that stays twice counts for half, so that both come nearer
        if off < 0.0:
            low, below = middle, off
            above, kept = (0.5 * above if kept > 0 else above), 1
        else:
            high, above = middle, off
            below, kept = (0.5 * below if kept < 0 else below), -1
    return 0.5 * (low + high)


def _quadrature(low: float, high: float, count: int) -> tuple[F64, F64]:
    at, share = np.polynomial.legendre.leggauss(count)
    half = 0.5 * (high - low)
    return low + half * (at + 1.0), half * share


def _density(values: F64) -> F64:
    return np.asarray(np.exp(-0.5 * values**2) / math.sqrt(2.0 * math.pi))


def _below(value: float) -> float:
    return 0.5 * math.erfc(-value / math.sqrt(2.0))


def _require_limit(limit: float) -> None:
    if not 0.0 < limit < math.inf:
        raise ValueError(f"limit {limit}: expected above 0")
