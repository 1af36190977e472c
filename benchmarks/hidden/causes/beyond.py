"""More causes that are in no catalogue: what metal, floors and electronics may do besides.

Shapes are on purpose not those by which the diagnosis describes what it finds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.hidden.causes.cause import F64, POINT, Cause, State, six

NAMES = (
    "expansion along a guideway by one temperature",
    "kink in one position, over another",
    "both directions together",
    "a position by the spindle's warmth",
    "square of a position by a gradient",
    "three positions",
    "two temperatures together",
    "swing that grows along an axis",
    "restless drift",
    "sawtooth in time",
    "square of a gradient",
    "wave across two positions",
)


def beyond(
    axes: Sequence[str], travels: Mapping[str, tuple[float, float]], rng: np.random.Generator
) -> dict[str, Cause]:
    """One cause for each of `NAMES`, on a machine with three linear axes."""
    first, middle, last = axes
    centre = {a: 0.5 * sum(travels[a]) for a in axes}
    half = {a: 0.5 * (travels[a][1] - travels[a][0]) for a in axes}
    d = int(rng.integers(3))
    kink = float(rng.uniform(-0.4, 0.4))
    period = float(rng.uniform(1000.0, 1700.0))
    tooth = float(rng.uniform(2500.0, 4000.0))
    walk = np.cumsum(rng.normal(0.0, 1.0, 40))

    def scaled(s: State, a: str) -> F64:
        return np.asarray((s[a] - centre[a]) / half[a])

    def clock(s: State) -> F64:
        return np.asarray(s["t"], dtype=np.float64)

    def gradient(s: State) -> F64:
        return np.asarray(s["T_col_front"] - s["T_col_rear"])

    def wander(s: State) -> F64:
        t = clock(s)
        return np.interp(t, np.linspace(0.0, float(t.max()), len(walk)), walk)

    def warm(s: State) -> F64:
        return np.asarray(s["T_spindle"] - 23.0)

    column = ("T_col_front", "T_col_rear")
    shapes = (
        (lambda s: np.exp(scaled(s, first)) * (s["T_x"] - 20.0), (first, "T_x")),
        (lambda s: np.abs(scaled(s, first) - kink) * scaled(s, last), (first, last)),
        (
            lambda s: np.asarray(s[f"{first}_dir"]) * np.asarray(s[f"{middle}_dir"]),
            (f"{first}_dir", f"{middle}_dir"),
        ),
        (lambda s: scaled(s, middle) * warm(s), (middle, "T_spindle")),
        (lambda s: scaled(s, middle) ** 2 * gradient(s), (middle, *column)),
        (lambda s: scaled(s, first) * scaled(s, middle) * scaled(s, last), tuple(axes)),
        (lambda s: (s["T_amb"] - 21.0) * warm(s), ("T_amb", "T_spindle")),
        (lambda s: scaled(s, last) * np.sin(2.0 * np.pi * clock(s) / period), (last, "t")),
        (wander, ("t",)),
        (lambda s: (clock(s) / tooth) % 1.0, ("t",)),
        (lambda s: gradient(s) ** 2, column),
        (lambda s: np.sin(3.0 * (scaled(s, first) + scaled(s, middle))), (first, middle)),
    )
    found = {}
    for name, (shape, depends) in zip(NAMES, shapes, strict=True):
        found[name] = Cause(
            name, POINT, lambda s, shape=shape: six(s, d, shape(s)), depends=depends
        )
    return found
