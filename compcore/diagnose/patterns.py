"""Patterns: structure in residuals that is in no catalogue, described by what it depends on.

A pattern is a product of recorded quantities, a smooth surface over two of them, or an oscillation,
on one error motion. Patterns compete with the catalogue's effects under the same exact test; they
describe, they do not explain. Where a short product of recorded quantities suffices, it is offered
as a ready ``formula`` effect, marked as empirical.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, combinations_with_replacement
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from compcore.conditions import Conditions
from compcore.effects.base import ABOUT, FUNCTIONAL_POINT, Channel
from compcore.machine import Machine, own_component
from compcore.structure import is_rotary

F64 = NDArray[np.float64]

SURFACE_DEGREE = 4
_DEGREES: Mapping[str, tuple[int, ...]] = {
    "signal": (2, 8),
    "difference": (2,),
    "time": (8, 20),
}
"""Of smooth functions of one quantity; a restless drift takes many."""
_FINE, _COARSE = 0.25, 0.5
"""Steps of frequency, as parts of the resolution 1/span."""


@dataclass(frozen=True, eq=False)
class Variable:
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


class Wave(NamedTuple):
    """An oscillation in `v`, growing along an axis or not, with so many harmonics."""

    v: Variable
    period: float
    along: Variable | None
    harmonics: int


@dataclass(frozen=True, eq=False)
class Pattern:
    """One candidate description of structure.

    Attributes
    ----------
    depends_on
        Names of the recorded quantities.
    form
        In words: 'product', 'smooth function', 'oscillation with a period of …'.
    channel
        The error motion on which it acts.
    basis
        Shape (n, k), unit-free.
    terms
        Formula terms, one per column; empty where no short formula says it.
    factors
        Of a product: its factors' names, a squared one twice.
    wave
        Of an oscillation: what it is made of.
    made_of
        Names of the variables in it where they are not those of `depends_on`.
    """

    depends_on: tuple[str, ...]
    form: str
    channel: Channel
    basis: F64
    terms: tuple[str, ...] = ()
    factors: tuple[str, ...] = ()
    wave: Wave | None = None
    made_of: tuple[str, ...] = ()


def variables(machine: Machine, conditions: Conditions) -> list[Variable]:
    """The recorded quantities that varied: positions, signals, time, approach directions.

    Beside them the differences of temperatures of one role: two sensors on a column tell what bends
    it.
    """
    found: list[Variable] = []

    def add(name: str, value: F64, unit: str, family: str, of: tuple[str, ...] = ()) -> None:
        low, high = float(value.min()), float(value.max())
        if high > low:
            centre, scale = 0.5 * (low + high), 0.5 * (high - low)
            found.append(Variable(name, (value - centre) / scale, centre, scale, unit, family, of))

    for axis in machine.structure.axes:
        unit = "rad" if machine.axis(axis).rotary else "mm"
        add(axis, conditions.position(axis), unit, "position")
    for name, value in conditions.signals.items():
        declared = machine.signals.get(name)
        add(name, value, declared.unit if declared else "", "signal")
    for a, b in combinations(conditions.signals, 2):
        one, two = machine.signals.get(a), machine.signals.get(b)
        if one and two and one.temperature and one.role == two.role:
            difference = conditions.signals[a] - conditions.signals[b]
            add(f"({a} - {b})", difference, one.unit, "difference", (a, b))
    add("t", conditions.time, "s", "time")
    for axis in machine.structure.axes:
        direction = conditions.direction(axis)
        if (direction > 0).any() and (direction < 0).any():
            found.append(Variable(f"{axis}_dir", direction, 0.0, 1.0, "", "direction"))
    return found


def channels(machine: Machine) -> list[Channel]:
    """Error motions on which patterns are tried: the point itself, and every axis's tilts."""
    points = [Channel(FUNCTIONAL_POINT, c) for c in ("X", "Y", "Z")]
    tilts = [Channel(a, ABOUT[c]) for a in machine.structure.axes for c in ("X", "Y", "Z")]
    return points + tilts


def lever_axes(machine: Machine, channel: Channel) -> tuple[str, ...]:
    """Axes whose position is in the lever of a tilt, so that what is seen depends on them too."""
    if not channel.rotation:
        return ()
    order = machine.structure.axes
    at = order.index(channel.place)
    on_workpiece = channel.place in machine.structure.workpiece_side
    behind = order[at if on_workpiece else at + 1 :]
    along = {"A": "X", "B": "Y", "C": "Z"}[channel.component]
    return tuple(a for a in behind if not is_rotary(a) and own_component(a) != along)


def products(
    quantities: Sequence[Variable], on: Sequence[Channel], order: int = 3
) -> Iterator[Pattern]:
    """Products of up to `order` recorded quantities, each pair or triple of different families.

    A position may be squared, a signal or the time only where it stands alone; two signals make a
    product of their own, each counted from anywhere.
    """
    for count in range(1, order + 1):
        for chosen in combinations_with_replacement(quantities, count):
            names = [v.name for v in chosen]
            squared = {v.name for v in chosen if names.count(v.name) > 1}
            families = Counter(v.family for v in chosen)
            alone = count == 2 and (bool(squared) or families["signal"] == 2)
            if any(v.name in squared and v.family == "direction" for v in chosen):
                continue
            slow = families["signal"] + families["difference"] + families["time"]
            if (slow > 1 and not alone) or (count == 1 and families["difference"]):
                continue
            parts = [chosen]
            if families["signal"] == 2 and not squared:
                parts += [chosen[:1], chosen[1:]]
            basis = np.stack([np.prod([v.value for v in part], axis=0) for part in parts], axis=1)
            terms = tuple(term_of(part) for part in parts)
            depends = tuple(dict.fromkeys(n for v in chosen for n in v.recorded))
            form = _product_form(tuple(dict.fromkeys(names)), squared)
            for channel in on:
                yield Pattern(depends, form, channel, basis, terms, tuple(names))


def surfaces(
    quantities: Sequence[Variable], on: Sequence[Channel], degree: int = SURFACE_DEGREE
) -> Iterator[Pattern]:
    """Smooth functions of one quantity, and of each pair with a position in it.

    A function of one position alone is an error motion of that axis: the catalogue has it, as such
    or as more detail of what the model has.
    """
    for v in quantities:
        for most in _DEGREES.get(v.family, ()):
            basis = _f64(chebyshev.chebvander(v.value, most)[:, 1:])
            for channel in on:
                form = f"smooth function of {v.name}"
                yield Pattern(v.recorded, form, channel, basis, made_of=(v.name,))
    smooth = [v for v in quantities if v.family not in ("direction", "difference")]
    for a, b in combinations(smooth, 2):
        if a.family != "position":
            continue
        one = chebyshev.chebvander(a.value, degree)
        two = chebyshev.chebvander(b.value, degree)
        basis = _f64(one[:, 1:, None] * two[:, None, 1:]).reshape(len(a.value), -1)
        for channel in on:
            yield Pattern(
                (a.name, b.name), f"smooth function of {a.name} and {b.name}", channel, basis
            )
    for a in (q for q in quantities if q.family == "position"):
        for b in (q for q in quantities if q.family in ("signal", "difference")):
            basis = _f64(chebyshev.chebvander(a.value, degree) * b.value[:, None])
            form = f"proportional to {b.name}, by a smooth function of {a.name}"
            for channel in on:
                depends = (a.name, *b.recorded)
                yield Pattern(depends, form, channel, basis, made_of=(a.name, b.name))
    for v in (q for q in quantities if q.family == "direction"):
        for w in (q for q in smooth if q.family in ("position", "signal")):
            basis = _f64(v.value[:, None] * chebyshev.chebvander(w.value, degree))
            for channel in on:
                yield Pattern(
                    (w.name, v.name),
                    f"smooth function of {w.name}, of opposite sign in the two directions",
                    channel,
                    basis,
                )


def oscillations(
    quantities: Sequence[Variable], on: Sequence[Channel], shortest: Mapping[str, float]
) -> Iterator[Pattern]:
    """Sine and cosine in time and along each axis, over a grid of periods.

    `shortest` gives, for each quantity by name, the shortest period worth trying, in its unit.
    """
    for v in quantities:
        if v.family not in ("time", "position") or v.name not in shortest:
            continue
        span = 2.0 * v.scale
        for period in period_grid(shortest[v.name], 0.8 * span, _FINE / span):
            basis = _waves(v, period)
            for channel in on:
                yield oscillation(v, period, channel, basis=basis)


def swings(
    quantities: Sequence[Variable], on: Sequence[Channel], shortest: Mapping[str, float]
) -> Iterator[Pattern]:
    """Oscillations in time that grow along an axis from its middle: what tilts or stretches.

    Periods from twice `shortest` on, on a coarser grid.
    """
    time = next((q for q in quantities if q.family == "time"), None)
    if time is None or time.name not in shortest:
        return
    span = 2.0 * time.scale
    positions = [q for q in quantities if q.family == "position"]
    for period in period_grid(2.0 * shortest[time.name], 0.8 * span, _COARSE / span):
        waves = _waves(time, period)
        for along in positions:
            basis = along.value[:, None] * waves
            for channel in on:
                yield oscillation(time, period, channel, along, basis=basis)


def oscillation(
    v: Variable,
    period: float,
    channel: Channel,
    along: Variable | None = None,
    *,
    harmonics: int = 1,
    basis: F64 | None = None,
) -> Pattern:
    """One oscillation of a period (in the unit of the quantity), perhaps growing along an axis.

    With `harmonics` above 1 it repeats, but is not a sine.
    """
    if basis is None:
        basis = np.hstack([_waves(v, period / k) for k in range(1, harmonics + 1)])
        basis = basis if along is None else along.value[:, None] * basis
    grown = "" if along is None else f"{term_of([along])}*"
    arguments = [f"{2 * k}*pi*{v.name}/{period:.6g}" for k in range(1, harmonics + 1)]
    form = f"oscillation in {v.name} with a period of {_readable(period, v.unit)}"
    if along is not None:
        form += f", growing along {along.name}"
    if harmonics > 1:
        form += ", not a sine"
    return Pattern(
        (v.name,) if along is None else (along.name, v.name),
        form,
        channel,
        basis,
        tuple(f"{grown}{wave}({a})" for a in arguments for wave in ("cos", "sin")),
        wave=Wave(v, period, along, harmonics),
    )


def _waves(v: Variable, period: float) -> F64:
    phase = 2.0 * np.pi * (v.value * v.scale + v.centre) / period
    return np.stack([np.cos(phase), np.sin(phase)], axis=1)


def period_grid(shortest: float, longest: float, step: float) -> F64:
    """Periods whose frequencies lie `step` apart."""
    if not 0.0 < shortest < longest:
        return np.zeros(0)
    return np.asarray(1.0 / np.arange(1.0 / longest, 1.0 / shortest, step))


def _readable(period: float, unit: str) -> str:
    if unit == "s" and period >= 120.0:
        return f"{period / 60.0:.3g} min"
    return f"{period:.3g} {unit}"


def _f64(values: ArrayLike) -> F64:
    return np.asarray(values, dtype=np.float64)


def term_of(factors: Sequence[Variable]) -> str:
    """A product of quantities as a formula has it: each counted from its middle, by half its range.

    Equal factors become a power; no factors give 1.
    """
    counts = Counter(v.name for v in factors)
    by_name = {v.name: v for v in factors}
    parts = [
        _scaled(by_name[name]) + (f"**{power}" if power > 1 else "")
        for name, power in counts.items()
    ]
    return "*".join(parts) or "1"


def _scaled(v: Variable) -> str:
    if v.family == "direction":
        return v.name
    if v.centre == 0.0:
        return f"({v.name}/{v.scale:.6g})"
    sign = "-" if v.centre > 0.0 else "+"
    return f"(({v.name} {sign} {abs(v.centre):.6g})/{v.scale:.6g})"


def _product_form(names: Sequence[str], squared: set[str]) -> str:
    parts = [f"{n}²" if n in squared else n for n in names]
    return "proportional to " + parts[0] if len(parts) == 1 else "product of " + " and ".join(parts)
