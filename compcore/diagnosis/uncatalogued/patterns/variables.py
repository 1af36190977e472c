"""Recorded quantities as patterns use them, scaled, and as formulas name them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PatternVariable:
    """A recorded quantity as patterns use it.

    Attributes
    ----------
    name
        As formulas name it: ``X``, ``T_amb``, ``t``, ``X_dir``.
    value
        Shape (n,), scaled to about −1 … 1.
    centre, scale
        ``value = (recorded − centre) / scale``, in the recorded unit.
    unit
        Unit inside the code, for people.
    family
        ``position``, ``signal``, ``difference`` (of two signals), ``time`` or ``direction``.
    of
        Of a difference: the two recorded quantities' names; else empty.
    """

    name: str
    value: F64
    centre: float
    scale: float
    unit: str
    family: str
    of: tuple[str, ...] = ()

    @property
    def recorded(self) -> tuple[str, ...]:
        """Names of the recorded quantities that it is made of."""
        return self.of or (self.name,)


def variables(machine: Machine, conditions: Conditions) -> list[PatternVariable]:
    """The recorded quantities that varied: positions, signals, time, approach directions.

    A column that the machine does not declare as a signal is none: no effect could read it.
    Beside them the differences of temperatures of one role: two sensors on a column tell what bends
    it.
    """
    found: list[PatternVariable] = []

    def add(name: str, value: F64, unit: str, family: str, of: tuple[str, ...] = ()) -> None:
        low, high = float(value.min()), float(value.max())
        if high > low:
            centre, scale = 0.5 * (low + high), 0.5 * (high - low)
            found.append(
                PatternVariable(name, (value - centre) / scale, centre, scale, unit, family, of)
            )

    for axis in machine.structure.axes:
        unit = "rad" if machine.axis(axis).rotary else "mm"
        add(axis, conditions.position(axis), unit, "position")
    for name, value in conditions.signals.items():
        if name in machine.signals:
            add(name, value, machine.signals[name].unit, "signal")
    for a, b in combinations(conditions.signals, 2):
        one, two = machine.signals.get(a), machine.signals.get(b)
        if one and two and one.temperature and one.role == two.role:
            difference = conditions.signals[a] - conditions.signals[b]
            add(f"({a} - {b})", difference, one.unit, "difference", (a, b))
    add("t", conditions.time, "s", "time")
    for axis in machine.structure.axes:
        direction = conditions.direction(axis)
        if (direction > 0).any() and (direction < 0).any():
            found.append(PatternVariable(f"{axis}_dir", direction, 0.0, 1.0, "", "direction"))
    return found


def term_of(factors: Sequence[PatternVariable]) -> str:
    """A product of quantities as a formula has it: each counted from its middle.

    Equal factors become a power; no factors give 1. Nothing is divided by a range: a coefficient
    would be one for the range, and its unit, which counts mm and K, would not say so.
    """
    counts = Counter(v.name for v in factors)
    by_name = {v.name: v for v in factors}
    parts = [
        _from_its_middle(by_name[name]) + (f"**{power}" if power > 1 else "")
        for name, power in counts.items()
    ]
    return "*".join(parts) or "1"


def _from_its_middle(v: PatternVariable) -> str:
    if v.family == "direction" or v.centre == 0.0:
        return v.name
    sign = "-" if v.centre > 0.0 else "+"
    return f"({v.name} {sign} {abs(v.centre):.6g})"
