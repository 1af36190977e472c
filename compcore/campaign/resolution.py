"""The resolution of readings, where it is coarse enough to be seen: a display of 1 or 5 µm.

Readings that step are off by up to half a step. Over places these errors are evenly spread, with a
standard deviation of a step through √12 (JCGM 100:2008, F.2.2.1). Repeats at one place do not show
them where the machine scatters less than a step: they all read the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind

F64 = NDArray[np.float64]

_FEWEST = 8
"""Readings."""
_STEPS = 3
"""Readings that differ."""
_ON_A_STEP = 1e-3
"""Part of a step by which readings that step may be off it, for rounding."""
_COARSE = 4.0
"""Steps in the readings' range for each of them, up to which they are seen to step."""
_DISPLAYED = (1.0, 2.0, 2.5, 5.0, 10.0)
"""By what a display steps, times a power of ten of a mm or rad."""


def step_of(campaign: Campaign, kinds: Sequence[Kind]) -> float:
    """The step by which a campaign's readings of some kinds go, mm or rad; 0 where none is seen.

    Distances are not asked: what is read is an indicated length beside a calibrated one.
    """
    read = [k for k in kinds if k < Kind.DISTANCE or k == Kind.ROTATION]
    return coarse_step(campaign.value[np.isin(campaign.kind, read)])


def coarse_step(readings: F64) -> float:
    """The step of readings, in their own unit; 0 where none is coarse enough to be seen.

    Parameters
    ----------
    readings
        Shape (n,), in any order; those that repeat count once.
    """
    values = np.unique(readings)
    if len(readings) < _FEWEST or len(values) < _STEPS:
        return 0.0
    size = float(np.abs(values).max())
    steps = np.diff(values)
    step = float(steps[steps > 1e-9 * size].min(initial=math.inf))
    if not math.isfinite(step) or not _of_a_display(step):
        return 0.0
    if float(np.ptp(values)) > _COARSE * len(values) * step:
        return 0.0
    counted = values / step
    return step if float(np.abs(counted - np.rint(counted)).max()) < _ON_A_STEP else 0.0


def of_step(step: float) -> float:
    """The standard deviation that readings have by stepping, in the step's unit."""
    return step / math.sqrt(12.0)


def _of_a_display(step: float) -> bool:
    leading = step / 10.0 ** math.floor(math.log10(step) + 1e-9)
    return any(abs(leading / one - 1.0) < _ON_A_STEP for one in _DISPLAYED)
