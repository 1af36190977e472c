"""Where a campaign paused over a night: what a machine's bodies did then nobody recorded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

NIGHT = 6.0 * 3600.0
"""Pause, s, after which how warm a body is says its first reading, not the last before it."""

_USUAL = 20.0
"""Times the usual time between readings that a night is longer."""


def stretches_between_nights(time: F64) -> NDArray[np.int64]:
    """The number of each row's stretch, from 0 on: a campaign that paused over nights has several.

    Signals are taken as straight between readings. From the warm evening to the cool morning
    they were not, and a body that follows them would begin the day far too warm.

    Parameters
    ----------
    time
        Of the rows, s, (n,), in any order.

    Returns
    -------
    Shape (n,).
    """
    t = np.unique(time)
    gaps = np.diff(t)
    if not gaps.size:
        return np.zeros(len(time), dtype=np.int64)
    nights = (gaps >= NIGHT) & (gaps > _USUAL * np.median(gaps))
    return np.searchsorted(t[1:][nights], time, side="right").astype(np.int64)
