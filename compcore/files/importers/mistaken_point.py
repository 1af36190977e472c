"""Which one point of a tracker is a mistake: without it the others are this machine's."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

_TRIED = 10
"""Points, those of which most is left, of which each is left out in its turn."""
_FALLS = 0.1
"""Part of what is left that remains without a point that is a mistake."""


def mistaken_point(left: F64, rms_of: Callable[[Index], float]) -> tuple[int, float] | None:
    """The point without which a tenth at the most is left of all others, and how much that is.

    Parameters
    ----------
    left
        What is left of each point in the fit of all, shape (n, 3), mm.
    rms_of
        What the points with some numbers leave, fitted by themselves, mm rms.

    Returns
    -------
    Its number and what is left without it, mm rms; None where there is none.
    """
    every = np.arange(len(left))
    worst = np.argsort(-np.linalg.norm(left, axis=1))[:_TRIED]
    without = {int(k): rms_of(np.delete(every, k)) for k in worst}
    best = min(without, key=lambda k: without[k])
    fits = without[best] < _FALLS * float(np.sqrt(np.mean(left**2)))
    return (best, without[best]) if fits else None
