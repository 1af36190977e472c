"""Set-ups of a calibrated gauge that the machine itself touches: where it can lie.

It lies across the stylus: along the two axes and on both diagonals between them. Along the stylus
only one of two faces could be reached.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.calibrated_gauge import CalibratedGauge
from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.planning.instruments import PlannedInstrument
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.targets import SurveyTask

F64 = NDArray[np.float64]

_ASIDE, _OVER = 30.0, 70.0
"""Room that the tip needs beside the gauge and over it, mm."""
_HALF = np.sqrt(0.5)


def probed_gauges(
    task: SurveyTask, instrument: PlannedInstrument, gauge: CalibratedGauge
) -> Iterator[PlannedSetup]:
    """A gauge along each axis across the stylus and both diagonals, in nine places each."""
    if any(a not in task.machine.axes for a in "XYZ"):
        return
    tool, offset = next(iter(task.tools.items()))
    away = -np.asarray(offset)
    up = int(np.argmax(np.abs(away))) if away.any() else 2
    rising = away[up] >= 0.0
    one, two = (np.eye(3)[(up + k) % 3] for k in (1, 2))
    names = ["XYZ"[(up + k) % 3] for k in (1, 2)]
    ways = (
        (names[0], one), (names[1], two),
        (f"{names[0]}+ {names[1]}+", _HALF * (one + two)),
        (f"{names[0]}+ {names[1]}−", _HALF * (one - two)),
    )  # fmt: skip
    for (words, way), height, across in product(ways, (0.0, 0.5, 1.0), (0.0, 0.5, 1.0)):
        own = np.outer(gauge.places, way)
        own = own - own.min(axis=0)
        size = own.max(axis=0)
        low, high = np.zeros(3), np.zeros(3)
        for k in range(3):
            ends = task.ends("XYZ"[k])
            low[k], high[k] = ends[0] + offset[k] + _ASIDE, ends[1] + offset[k] - _ASIDE
        over = _OVER + 0.5 * gauge.height - _ASIDE
        low[up] += 0.0 if rising else over
        high[up] -= over if rising else 0.0
        spare = high - low - size
        if (spare < 0.0).any():
            continue
        part = np.full(3, 0.5)
        part[up] = height
        free = max((k for k in range(3) if k != up), key=lambda k: spare[k])
        part[free] = across
        path = own + low + part * spare
        targets = {a: np.full(len(own), v) for a, v in task.standing().items()}
        for k, a in enumerate("XYZ"):
            targets[a] = np.round(path[:, k] - offset[k], 3)
        lies = ", ".join(f"{a} {targets[a].min():.0f} to {targets[a].max():.0f}" for a in "XYZ")
        sd = [instrument.uncertainty(float(length)) for length in gauge.places]
        made = PlannedSetup(
            instrument, f"gauge of {gauge.length:.0f} mm along {words}, {lies}", "",
            targets, np.tile(way, (len(own), 1, 1)), Kind.DISPLACEMENT, ("zero",),
            np.array(sd), tool, offset, both_ways=False,
        )  # fmt: skip
        for i in (0, len(own) - 1):
            x, y, z = made.path()[i].tolist()
            made.optics[f"face {gauge.faces[i]}"] = (x, y, z)
        yield made
