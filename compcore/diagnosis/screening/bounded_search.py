"""The least value of a function of one number between bounds, by Brent's method.

The same steps as SciPy's ``minimize_scalar(method="bounded")``, without the import of its
optimisers, which would take longer than the search.
"""

from __future__ import annotations

import math
from collections.abc import Callable

_GOLDEN = 0.5 * (3.0 - math.sqrt(5.0))
_ROOT_OF_ROUNDING = math.sqrt(2.2e-16)
_MOST = 500


def least(
    function: Callable[[float], float], bounds: tuple[float, float], within: float
) -> tuple[float, float]:
    """Where a function is least, and its value there.

    Parameters
    ----------
    function
        The function; where it has several valleys one of them is found.
    bounds
        Lower and upper bound of its argument.
    within
        How closely the place is to be found.
    """
    low, high = bounds
    # the best place, the second best and the one before it, and the function there
    best = second = third = low + _GOLDEN * (high - low)
    f_best = f_second = f_third = function(best)
    step = before = 0.0
    for _ in range(_MOST):
        middle = 0.5 * (low + high)
        close = _ROOT_OF_ROUNDING * abs(best) + within / 3.0
        if abs(best - middle) <= 2.0 * close - 0.5 * (high - low):
            break
        golden = True
        if abs(before) > close:
            # the lowest point of a parabola through the three
            r = (best - second) * (f_best - f_third)
            q = (best - third) * (f_best - f_second)
            p = (best - third) * q - (best - second) * r
            q = 2.0 * (q - r)
            p, q = (-p if q > 0.0 else p), abs(q)
            r, before = before, step
            if abs(p) < abs(0.5 * q * r) and q * (low - best) < p < q * (high - best):
                golden = False
                step = p / q
                if min(best + step - low, high - best - step) < 2.0 * close:
                    step = close if middle >= best else -close
        if golden:
            before = (low if best >= middle else high) - best
            step = _GOLDEN * before
        x = best + math.copysign(max(abs(step), close), step)
        f = function(x)
        if f <= f_best:
            low, high = (best, high) if x >= best else (low, best)
            third, f_third = second, f_second
            second, f_second = best, f_best
            best, f_best = x, f
            continue
        low, high = (x, high) if x < best else (low, x)
        if f <= f_second or second == best:
            third, f_third = second, f_second
            second, f_second = x, f
        elif f <= f_third or third in (best, second):
            third, f_third = x, f
    return best, f_best
