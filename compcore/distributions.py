"""Tails of the normal, χ² and F distributions: the chance of so large a value by noise alone.

SciPy has them too, but its import takes longer than most commands of Abbe. Continued fractions and
series after Numerical Recipes, 3rd edition, 6.2 and 6.4; they agree with SciPy to 1e-10 of the
chance for up to 10⁵ degrees of freedom (2e-8 for 10⁷, where logarithms of gamma functions cancel);
docs/decisions/0043 has the figures.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

_ENOUGH = 1e-16
_TINY = 1e-300
_TERMS = 1_000_000
"""A bound that is never reached: terms grow as the root of the degrees of freedom."""


def normal_limit(chance: float) -> float:
    """What a standard normal variable exceeds with a chance below one half."""
    root = math.sqrt(0.5)
    return _where(lambda x: math.log(0.5 * math.erfc(x * root)), math.log(chance), 1.0)


def chi2_beyond(chi2: float, dof: float) -> float:
    """Chance of so large a χ², or a larger one, with `dof` degrees of freedom; NaN without any."""
    if not (dof > 0.0 and chi2 < math.inf):
        return 0.0 if dof > 0.0 and chi2 == math.inf else math.nan
    return math.exp(_log_gamma_tail(0.5 * dof, 0.5 * chi2)) if chi2 > 0.0 else 1.0


def chi2_limit(chance: float, dof: float) -> float:
    """The χ² that is exceeded with a chance, strictly between 0 and 1."""
    return 2.0 * _where(lambda x: _log_gamma_tail(0.5 * dof, x), math.log(chance), 0.5 * dof)


def log_f_beyond(f: float, k: float, dof: float) -> float:
    """Natural logarithm of the chance of so large an F with k and `dof` degrees of freedom.

    Finite however small the chance is; NaN without degrees of freedom.
    """
    if not (k > 0.0 and dof > 0.0 and f < math.inf):
        return -math.inf if k > 0.0 and dof > 0.0 and f == math.inf else math.nan
    if f <= 0.0:
        return 0.0
    whole = dof + k * f
    return _log_beta(dof / whole, k * f / whole, 0.5 * dof, 0.5 * k)


def f_beyond(f: float, k: float, dof: float) -> float:
    """Chance of so large an F, or a larger one, with k and `dof` degrees of freedom."""
    return math.exp(log_f_beyond(f, k, dof))


def f_limit(chance: float, k: float, dof: float) -> float:
    """The F that is exceeded with a chance, strictly between 0 and 1."""
    return _where(lambda f: log_f_beyond(f, k, dof), math.log(chance), 1.0)


def _where(log_tail: Callable[[float], float], wanted: float, start: float) -> float:
    """Where the falling logarithm of a tail has a value; by halving, in the logarithm of x."""
    low = high = start
    while log_tail(low) < wanted and low > _TINY:
        low *= 0.5
    while log_tail(high) > wanted:
        high *= 2.0
    while high - low > 4e-16 * high:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if log_tail(middle) > wanted:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def _log_gamma_tail(a: float, x: float) -> float:
    """Ln Q(a, x), the upper incomplete gamma function over the whole."""
    front = a * math.log(x) - x - math.lgamma(a)
    if x < a + 1.0:
        term = total = 1.0 / a
        for n in range(1, _TERMS):
            term *= x / (a + n)
            total += term
            if term < total * _ENOUGH:
                break
        return _log_rest(front + math.log(total))
    b = x + 1.0 - a
    c, d = 1.0 / _TINY, 1.0 / b
    product = d
    for n in range(1, _TERMS):
        step = -n * (n - a)
        b += 2.0
        c, d = _next(c, d, b, step)
        product *= c * d
        if abs(c * d - 1.0) < 2.0 * _ENOUGH:
            break
    return front + math.log(product)


def _log_beta(x: float, y: float, a: float, b: float) -> float:
    """Ln I_x(a, b), the incomplete beta function over the whole; y = 1 − x."""
    if x > (a + 1.0) / (a + b + 2.0):
        return _log_rest(_log_beta(y, x, b, a)) if y > 0.0 else 0.0
    if x <= 0.0:
        return -math.inf
    front = a * _log(x, y) + b * _log(y, x)
    front += math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b)
    c, d = 1.0, 1.0 / (1.0 - (a + b) * x / (a + 1.0))
    product = d
    for n in range(1, _TERMS):
        even = n * (b - n) * x / ((a + 2 * n - 1) * (a + 2 * n))
        c, d = _next(c, d, 1.0, even)
        product *= c * d
        odd = -(a + n) * (a + b + n) * x / ((a + 2 * n) * (a + 2 * n + 1))
        c, d = _next(c, d, 1.0, odd)
        product *= c * d
        if abs(c * d - 1.0) < 2.0 * _ENOUGH:
            break
    return front + math.log(product / a)


def _next(c: float, d: float, b: float, step: float) -> tuple[float, float]:
    """One step of a continued fraction by Lentz's method."""
    d = b + step * d
    c = b + step / c
    return (c if abs(c) > _TINY else _TINY), 1.0 / (d if abs(d) > _TINY else _TINY)


def _log(x: float, y: float) -> float:
    """Ln x where x + y = 1, exact near 1 too."""
    return math.log1p(-y) if y < 0.5 else math.log(x)


def _log_rest(log_part: float) -> float:
    """ln(1 − e^part), for a part below 1."""
    part = math.exp(min(log_part, 0.0))
    return math.log1p(-part) if part < 1.0 else math.log(_TINY)


def signed_rank_beyond(values: F64) -> float:
    """Chance that signs alone make so many, and so large, of the values positive (Wilcoxon, 1945).

    One side. Ranks only count, so one block that is much larger than the others neither makes nor
    spoils the test. Exact for untied values; zeros do not count.
    """
    told = values[values != 0.0]
    ranks = np.empty(len(told), dtype=np.int64)
    ranks[np.argsort(np.abs(told))] = np.arange(1, len(told) + 1)
    ways = np.ones(1)
    for rank in range(1, len(told) + 1):
        longer = np.zeros(len(ways) + rank)
        longer[: len(ways)] += 0.5 * ways
        longer[rank:] += 0.5 * ways
        ways = longer
    return float(ways[int(ranks[told > 0.0].sum()) :].sum())
