"""Hidden causes that are in no catalogue, and the formula that says each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.hidden.causes.cause import POINT, Cause, State, six

F64 = NDArray[np.float64]


def uncatalogued(
    axes: Sequence[str], travels: Mapping[str, tuple[float, float]], rng: np.random.Generator
) -> dict[str, Cause]:
    """Causes that are in no catalogue, of several kinds."""
    first, middle, last = axes
    centre = {a: 0.5 * sum(travels[a]) for a in axes}
    half = {a: 0.5 * (travels[a][1] - travels[a][0]) for a in axes}

    def scaled(s: State, a: str) -> F64:
        return np.asarray((s[a] - centre[a]) / half[a])

    def written(a: str) -> str:
        """The same as a formula has it."""
        return f"(({a}-({centre[a]:g}))/{half[a]:g})"

    period = float(rng.uniform(1000.0, 1700.0))
    d = int(rng.integers(3))
    channel = "d" + "XYZ"[d]

    def waves(seconds: float) -> tuple[str, ...]:
        return tuple(f"{f}(2*pi*t/{seconds!r})" for f in ("sin", "cos"))

    found = [
        Cause(
            "oscillation in time",
            POINT,
            lambda s: six(s, d, np.sin(2.0 * np.pi * np.asarray(s["t"]) / period + 1.0)),
            depends=("t",),
            formula=(channel, waves(period)),
        ),
        Cause(
            "two positions and a temperature",
            POINT,
            lambda s: six(s, d, scaled(s, first) * scaled(s, middle) * (s["T_amb"] - 21.0)),
            depends=(first, middle, "T_amb"),
            formula=(channel, (f"{written(first)}*{written(middle)}*(T_amb-21)",)),
        ),
        Cause(
            "saddle of two positions",
            POINT,
            lambda s: six(s, d, np.sin(2.0 * scaled(s, first)) * np.cos(2.5 * scaled(s, last))),
            depends=(first, last),
            formula=(channel, (f"sin(2*{written(first)})*cos(2.5*{written(last)})",)),
        ),
        Cause(
            "direction of one axis over another's position",
            POINT,
            lambda s: six(s, d, np.asarray(s[f"{middle}_dir"]) * scaled(s, last) ** 2),
            depends=(last, f"{middle}_dir"),
            formula=(channel, (f"{middle}_dir*{written(last)}**2",)),
        ),
        Cause(
            "square of a temperature",
            POINT,
            lambda s: six(s, d, (s["T_amb"] - 21.0) ** 2),
            depends=("T_amb",),
            formula=(channel, ("(T_amb-21)**2",)),
        ),
        Cause(
            "sudden hum of the foundation",
            POINT,
            lambda s: six(s, d, np.sin(2.0 * np.pi * np.asarray(s["t"]) / 420.0)),
            depends=("t",),
            formula=(channel, waves(420.0)),
        ),
    ]
    return {c.name: c for c in found}
