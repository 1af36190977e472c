"""A campaign whose thermometers were read by a clock that is late, as they would have been in time.

No body is as warm now as something will be in an hour; that its thermometer's column is late says
it. The other way round a body may be late itself, which is a lag and a cause.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

HOURS = (1.0, 2.0)
"""By which clocks are apart: summer time, or that and another zone's."""

_ENOUGH = 0.5
"""Part of the rows that must have a reading so much later, before the record or a night ends it."""


def shown_later(campaign: Campaign, seconds: float) -> NDArray[np.bool_] | None:
    """Which rows (n,) have readings by so many seconds later in the same stretch of time.

    None where they are too few.
    """
    conditions = campaign.conditions
    if not campaign.clocked or not seconds > 0.0:
        return None
    stretches = conditions.stretches
    kept = np.zeros(conditions.n, dtype=np.bool_)
    for one in np.unique(stretches):
        rows = stretches == one
        time = conditions.time[rows]
        kept[rows] = time + seconds <= time.max()
    return kept if kept.sum() > _ENOUGH * conditions.n else None


def read_later(campaign: Campaign, machine: Machine, seconds: float) -> dict[str, F64]:
    """Thermometer → what it reads so many seconds after each row, (n,), within its stretch."""
    conditions = campaign.conditions
    found = {}
    for name, values in conditions.signals.items():
        if name not in machine.signals or not machine.signals[name].temperature:
            continue
        later = values.copy()
        for one in np.unique(conditions.stretches):
            rows = np.flatnonzero(conditions.stretches == one)
            in_time = rows[np.argsort(conditions.time[rows], kind="stable")]
            time = conditions.time[in_time]
            later[rows] = np.interp(conditions.time[rows] + seconds, time, values[in_time])
        found[name] = later
    return found
