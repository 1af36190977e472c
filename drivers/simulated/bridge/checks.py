"""A year of check measurements: four spheres on the table, probed every working day.

What scatters is what scatters in a hall: each probing; the probe, qualified anew every morning; the
machine itself, which stands a little differently for days; the temperatures, by season, weather and
place, of which the model knows what the thermistors show.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from abbe.drivers.simulated.bridge.happened import Happened
from abbe.drivers.simulated.bridge.machine import AXES, PLACES, TOOL, make_bridge
from abbe.drivers.simulated.bridge.plant import SENSOR_NOISE

Array = NDArray[np.float64]
WhatHappens: TypeAlias = Literal["nothing", "crash", "levelling", "sensor", "quill"]

WHAT_HAPPENS: Final[tuple[WhatHappens, ...]] = ("nothing", "crash", "levelling", "sensor", "quill")

SPHERES: Final[Mapping[str, tuple[float, float, float]]] = {
    "sphere1": (80.0, 100.0, -300.0),
    "sphere2": (620.0, 120.0, -60.0),
    "sphere3": (100.0, 800.0, -80.0),
    "sphere4": (600.0, 780.0, -320.0),
}
"""Indicated positions at which they are probed, mm. Nobody has calibrated where they stand."""

STATED: Final = 0.5e-3
"""Standard uncertainty of a probed centre, as the operator states it, mm."""
PROBING, QUALIFYING, WANDERING = 0.4e-3, 0.5e-3, 0.3e-3
"""Standard deviations: of a centre, of the probe from day to day, of the machine over days, mm."""
DAYS: Final = 3.0
"""After so many a deviation of machine or temperatures has fallen to 1/e."""
FIRST_DAY: Final = 1_767_600_000.0
"""5 January 2026, 8:00 UTC, a Monday; s since 1970."""
DAY: Final = 86_400.0
MONTH: Final = 20
"""Working days."""


def what_happened(what: WhatHappens, since: int) -> Happened:
    """What has happened `since` checks after the machine was last sound; 0: nothing yet.

    A crash turns X on Y by 10 µrad; new levelling twists the bed by 15 µrad per metre; the
    thermistors of X's scale read 0.2 K more each month; the quill grows by 0.5 µm/K more each
    month.
    """
    if since < 1:
        return Happened()
    months = since / MONTH
    return {
        "nothing": Happened(),
        "crash": Happened(squareness=10e-6),
        "levelling": Happened(twist=15e-9),
        "sensor": Happened(sensors=0.2 * months),
        "quill": Happened(growth=0.5e-3 * months),
    }[what]


def year_of_checks(
    seed: int = 1, what: WhatHappens = "nothing", at: int = 120, checks: int = 250, year: int = 0
) -> str:
    """A campaign file's text (``abbe-campaign/1``) with the checks of a year.

    Parameters
    ----------
    seed
        Of the machine, as for `measure.campaign`.
    what, at
        What happens to the machine, and after how many checks.
    checks
        How many working days.
    year
        Another weather and another scatter for the same machine.

    Raises
    ------
    ValueError
        For something else that happens.
    """
    if what not in WHAT_HAPPENS:
        raise ValueError(f"what happens {what!r}; expected one of {', '.join(WHAT_HAPPENS)}")
    machine = make_bridge(seed)
    rng = np.random.default_rng(np.random.SeedSequence([seed, 250, year]))
    days = np.array([7 * (k // 5) + k % 5 for k in range(checks)], dtype=float)
    temperatures = _weather(rng, days)
    wander = WANDERING * _lasting(rng, days, DAYS, 3)
    places = np.array(list(SPHERES.values()))
    lines = [
        '# format = "abbe-campaign/1"',
        '# machine = "Simulated bridge CMM"',
        '# instrument = "four spheres, screwed to the table"',
    ]
    for name in SPHERES:
        for axis in AXES:
            lines += [f"# [setups.{name}_{axis}]", '# free = ["zero"]']
    columns = ["tool_x", "tool_y", "tool_z", "ux", "uy", "uz", "value", "sd"]
    lines.append(",".join(["time", "setup", "kind", *AXES, *columns, *PLACES]))
    for k in range(checks):
        now = what_happened(what, k - at + 1).to(machine)
        error = now.error(places, np.broadcast_to(temperatures[k], (len(places), len(PLACES))))
        error = error + wander[k] + QUALIFYING * rng.normal(size=3)
        error = error + PROBING * rng.normal(size=error.shape)
        shown = temperatures[k] + now.sensor_errors + rng.normal(0.0, SENSOR_NOISE, len(PLACES))
        for s, (name, place) in enumerate(SPHERES.items()):
            for i, axis in enumerate(AXES):
                fields = [
                    f"{FIRST_DAY + days[k] * DAY + 60.0 * s:.0f}",
                    f"{name}_{axis}",
                    "displacement",
                    *(f"{q:g}" for q in (*place, *TOOL)),
                    *(str(int(i == j)) for j in range(3)),
                    f"{error[s, i] * 1e3:.3f}",
                    f"{STATED * 1e3:g}",
                    *(f"{t:.4f}" for t in shown),
                ]
                lines.append(",".join(fields))
    return "\n".join(lines) + "\n"


def _weather(rng: np.random.Generator, days: Array) -> Array:
    """True temperatures of all places on some days, (checks, places), °C."""
    season = 0.9 * np.sin(2.0 * math.pi * (days - 100.0) / 365.0)
    hall = 20.0 + season[:, None] + 0.4 * _lasting(rng, days, DAYS, 1)
    return np.asarray(hall + 0.1 * _lasting(rng, days, DAYS, len(PLACES)))


def _lasting(rng: np.random.Generator, days: Array, last: float, count: int) -> Array:
    """Deviations of variance 1 that last, (checks, count): Ornstein and Uhlenbeck's."""
    out = rng.normal(size=(len(days), count))
    for k in range(1, len(days)):
        stays = math.exp(-(days[k] - days[k - 1]) / last)
        out[k] = stays * out[k - 1] + math.sqrt(1.0 - stays**2) * out[k]
    return out
