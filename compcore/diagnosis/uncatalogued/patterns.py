"""Patterns: structure in residuals that is in no catalogue, described by what it depends on.

A pattern is a product of recorded quantities, a smooth surface over two of them, or an oscillation,
on one error motion. Patterns compete with the catalogue's effects under the same exact test; they
describe, they do not explain. Where a short product of recorded quantities suffices, it is offered
as a ready ``formula`` effect, marked as empirical.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import combinations, combinations_with_replacement
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from abbe.compcore.effects.base import ABOUT, FUNCTIONAL_POINT, ErrorMotion
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.machine.structure import is_rotary

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


Rows = NDArray[np.int64] | slice
Values = Callable[[Rows], F64]


class Wave(NamedTuple):
    """An oscillation in `v`, growing along an axis or not, with so many harmonics."""

    v: PatternVariable
    period: float
    along: PatternVariable | None
    harmonics: int


@dataclass(frozen=True, eq=False)
class CandidatePattern:
    """One candidate description of structure.

    Attributes
    ----------
    depends_on
        Names of the recorded quantities.
    form
        In words: 'product', 'smooth function', 'oscillation with a period of …'.
    error_motion
        The error motion on which it acts.
    width
        Number k of its coefficients.
    values
        Rows → its basis functions there, shape (rows, k), unit-free.
    terms
        Formula terms, one per column; empty where no short formula says it.
    factors
        Of a product: its factors' names, a squared one twice.
    wave
        Of an oscillation: what it is made of.
    made_of
        Names of the variables in it where they are not those of `depends_on`.
    once
        Names of the variables that stand in each of its functions as a plain factor.
    """

    depends_on: tuple[str, ...]
    form: str
    error_motion: ErrorMotion
    width: int
    values: Values
    terms: tuple[str, ...] = ()
    factors: tuple[str, ...] = ()
    wave: Wave | None = None
    made_of: tuple[str, ...] = ()
    once: tuple[str, ...] = ()

    @property
    def basis(self) -> F64:
        """Its basis functions on all rows, shape (n, k)."""
        return self.values(slice(None))

    def on(self, error_motion: ErrorMotion) -> CandidatePattern:
        """The same on another error motion."""
        return replace(self, error_motion=error_motion)


@dataclass(frozen=True, eq=False)
class PatternGroup:
    """Forms of one width, each of which is tried on several error motions.

    Attributes
    ----------
    count, width
        How many forms, and the number of coefficients of each.
    values
        (first, last) of the forms, and rows → their basis functions, (forms · width, rows).
    form
        Number of a form → the pattern on any error motion, put in words.
    of
        The recorded quantity on whose value alone all of them depend, where there is one.
    """

    count: int
    width: int
    values: Callable[[tuple[int, int], Rows], F64]
    form: Callable[[int], CandidatePattern]
    of: PatternVariable | None = None


def grouped(forms: Sequence[CandidatePattern]) -> list[PatternGroup]:
    """Forms by their width."""
    by_width: dict[int, list[CandidatePattern]] = {}
    for form in forms:
        by_width.setdefault(form.width, []).append(form)

    def values(mine: Sequence[CandidatePattern], which: tuple[int, int], rows: Rows) -> F64:
        return np.concatenate([form.values(rows).T for form in mine[slice(*which)]])

    return [
        PatternGroup(len(mine), width, partial(values, mine), mine.__getitem__)
        for width, mine in by_width.items()
    ]


def variables(machine: Machine, conditions: Conditions) -> list[PatternVariable]:
    """The recorded quantities that varied: positions, signals, time, approach directions.

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
            found.append(PatternVariable(f"{axis}_dir", direction, 0.0, 1.0, "", "direction"))
    return found


def error_motions(machine: Machine) -> list[ErrorMotion]:
    """Error motions on which patterns are tried: the point itself, and every axis's tilts."""
    points = [ErrorMotion(FUNCTIONAL_POINT, c) for c in ("X", "Y", "Z")]
    tilts = [ErrorMotion(a, ABOUT[c]) for a in machine.structure.axes for c in ("X", "Y", "Z")]
    return points + tilts


def lever_axes(machine: Machine, error_motion: ErrorMotion) -> tuple[str, ...]:
    """Axes whose position is in the lever of a tilt, so that what is seen depends on them too."""
    if not error_motion.rotation:
        return ()
    order = machine.structure.axes
    at = order.index(error_motion.place)
    on_workpiece = error_motion.place in machine.structure.workpiece_side
    behind = order[at if on_workpiece else at + 1 :]
    along = {"A": "X", "B": "Y", "C": "Z"}[error_motion.component]
    return tuple(a for a in behind if not is_rotary(a) and own_component(a) != along)


def products(
    quantities: Sequence[PatternVariable], on: ErrorMotion, order: int = 3
) -> Iterator[CandidatePattern]:
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
            values = partial(_products, parts)
            terms = tuple(term_of(part) for part in parts)
            depends = tuple(dict.fromkeys(n for v in chosen for n in v.recorded))
            form = _product_form(tuple(dict.fromkeys(names)), squared)
            yield CandidatePattern(depends, form, on, len(parts), values, terms, tuple(names))


def surfaces(
    quantities: Sequence[PatternVariable], on: ErrorMotion, degree: int = SURFACE_DEGREE
) -> Iterator[CandidatePattern]:
    """Smooth functions of one quantity, and of each pair with a position in it.

    A function of one position alone is an error motion of that axis: the catalogue has it, as such
    or as more detail of what the model has.
    """
    for v in quantities:
        for most in _DEGREES.get(v.family, ()):
            values = partial(_smooth, v, most)
            form = f"smooth function of {v.name}"
            yield CandidatePattern(v.recorded, form, on, most, values, made_of=(v.name,))
    smooth = [v for v in quantities if v.family not in ("direction", "difference")]
    for a, b in combinations(smooth, 2):
        if a.family != "position":
            continue
        values = partial(_surface, a, b, degree)
        form = f"smooth function of {a.name} and {b.name}"
        yield CandidatePattern((a.name, b.name), form, on, degree**2, values)
    for a in (q for q in quantities if q.family == "position"):
        for b in (q for q in quantities if q.family in ("signal", "difference")):
            values = partial(_times_smooth, b, a, degree)
            form = f"proportional to {b.name}, by a smooth function of {a.name}"
            depends, made_of = (a.name, *b.recorded), (a.name, b.name)
            yield CandidatePattern(
                depends, form, on, degree + 1, values, made_of=made_of, once=(b.name,)
            )
    for v in (q for q in quantities if q.family == "direction"):
        for w in (q for q in smooth if q.family in ("position", "signal")):
            values = partial(_times_smooth, v, w, degree)
            form = f"smooth function of {w.name}, of opposite sign in the two directions"
            yield CandidatePattern((w.name, v.name), form, on, degree + 1, values, once=(v.name,))


def oscillations(
    quantities: Sequence[PatternVariable], on: ErrorMotion, shortest: Mapping[str, float]
) -> Iterator[PatternGroup]:
    """Sine and cosine in time and along each axis, over a grid of periods.

    `shortest` gives, for each quantity by name, the shortest period worth trying, in its unit.
    """
    for v in quantities:
        if v.family in ("time", "position") and v.name in shortest:
            span = 2.0 * v.scale
            periods = period_grid(shortest[v.name], 0.8 * span, _FINE / span)
            yield _of_periods(v, periods, on)


def swings(
    quantities: Sequence[PatternVariable], on: ErrorMotion, shortest: Mapping[str, float]
) -> Iterator[PatternGroup]:
    """Oscillations in time that grow along an axis from its middle: what tilts or stretches.

    Periods from twice `shortest` on, on a coarser grid.
    """
    time = next((q for q in quantities if q.family == "time"), None)
    if time is None or time.name not in shortest:
        return
    span = 2.0 * time.scale
    periods = period_grid(2.0 * shortest[time.name], 0.8 * span, _COARSE / span)
    for along in (q for q in quantities if q.family == "position"):
        yield _of_periods(time, periods, on, along)


def _of_periods(
    v: PatternVariable, periods: F64, on: ErrorMotion, along: PatternVariable | None = None
) -> PatternGroup:
    def values(which: tuple[int, int], rows: Rows) -> F64:
        basis = _waves(v, periods[slice(*which)], rows)
        return basis if along is None else basis * along.value[rows]

    def form(number: int) -> CandidatePattern:
        return oscillation(v, float(periods[number]), on, along)

    return PatternGroup(len(periods), 2, values, form, v if along is None else None)


def oscillation(
    v: PatternVariable,
    period: float,
    error_motion: ErrorMotion,
    along: PatternVariable | None = None,
    *,
    harmonics: int = 1,
) -> CandidatePattern:
    """One oscillation of a period (in the unit of the quantity), perhaps growing along an axis.

    With `harmonics` above 1 it repeats, but is not a sine.
    """
    wave = Wave(v, period, along, harmonics)
    grown = "" if along is None else f"{term_of([along])}*"
    arguments = [f"{2 * k}*pi*{v.name}/{period:.6g}" for k in range(1, harmonics + 1)]
    form = f"oscillation in {v.name} with a period of {_readable(period, v.unit)}"
    if along is not None:
        form += f", growing along {along.name}"
    if harmonics > 1:
        form += ", not a sine"
    return CandidatePattern(
        (v.name,) if along is None else (along.name, v.name),
        form,
        error_motion,
        2 * harmonics,
        partial(_repeating, wave),
        tuple(f"{grown}{turn}({a})" for a in arguments for turn in ("cos", "sin")),
        wave=wave,
    )


def _waves(v: PatternVariable, periods: F64, rows: Rows) -> F64:
    """Cosine and sine of several periods, shape (2 · periods, rows)."""
    angle = 2.0 * np.pi * (v.value[rows] * v.scale + v.centre)
    out = np.empty((len(periods), 2, len(angle)))
    for first, last in _even_runs(1.0 / periods):
        turns = _turns(angle, 1.0 / periods[first], 1.0 / periods[last - 1], last - first)
        out[first:last, 0] = turns.real
        out[first:last, 1] = turns.imag
    return out.reshape(-1, len(angle))


def _even_runs(frequencies: F64) -> Iterator[tuple[int, int]]:
    """First and last + 1 of each run of frequencies that lie equally far apart."""
    steps = np.diff(frequencies)
    size = float(np.abs(frequencies).max())
    first = 0
    while first < len(frequencies):
        uneven = np.abs(steps[first:] - steps[first : first + 1]) > 1e-12 * size
        last = first + int(uneven.argmax()) + 1 if uneven.any() else len(frequencies)
        yield first, last
        first = last


def _turns(angle: F64, low: float, high: float, count: int) -> NDArray[np.complex128]:
    """``exp(i·f·angle)`` at `count` even frequencies f, shape (count, len(angle)).

    By doubling: what is known, turned on by as many steps. A product is far cheaper than a sine,
    and none is of more than log₂(count) + 1 factors.
    """
    step = (high - low) / max(1, count - 1)
    out = np.empty((count, len(angle)), dtype=np.complex128)
    out[0] = np.exp(1j * low * angle)
    known = 1
    while known < count:
        more = min(known, count - known)
        np.multiply(out[:more], np.exp(1j * known * step * angle), out=out[known : known + more])
        known += more
    return out


def _repeating(wave: Wave, rows: Rows) -> F64:
    periods = wave.period / np.arange(1, wave.harmonics + 1)
    basis = _waves(wave.v, periods, rows)
    return (basis if wave.along is None else basis * wave.along.value[rows]).T


def oscillating(patterns: Sequence[CandidatePattern], rows: Rows) -> F64 | None:
    """Basis functions of oscillations, (patterns · 2, rows).

    Their quantity and what they grow along are those of the first; None for any other patterns.
    """
    waves = [p.wave for p in patterns if p.wave is not None and p.wave.harmonics == 1]
    if len(waves) < len(patterns):
        return None
    basis = _waves(waves[0].v, np.array([w.period for w in waves]), rows)
    if waves[0].along is not None:
        basis *= waves[0].along.value[rows]
    return basis


def with_product(pattern: CandidatePattern, factors: Sequence[PatternVariable]) -> CandidatePattern:
    """A pattern with one more column, a product of quantities."""

    def values(rows: Rows) -> F64:
        return np.hstack([pattern.values(rows), _products([factors], rows)])

    terms = (*pattern.terms, term_of(factors))
    return replace(pattern, width=pattern.width + 1, values=values, terms=terms)


def _products(parts: Sequence[Sequence[PatternVariable]], rows: Rows) -> F64:
    columns = [reduce(np.multiply, (v.value[rows] for v in part)) for part in parts]
    return columns[0][:, None] if len(columns) == 1 else np.stack(columns, axis=1)


def _smooth(v: PatternVariable, degree: int, rows: Rows) -> F64:
    return _f64(chebyshev.chebvander(v.value[rows], degree)[:, 1:])


def _surface(a: PatternVariable, b: PatternVariable, degree: int, rows: Rows) -> F64:
    one = chebyshev.chebvander(a.value[rows], degree)[:, 1:, None]
    two = chebyshev.chebvander(b.value[rows], degree)[:, None, 1:]
    return _f64(one * two).reshape(len(one), -1)


def _times_smooth(v: PatternVariable, w: PatternVariable, degree: int, rows: Rows) -> F64:
    return _f64(chebyshev.chebvander(w.value[rows], degree) * v.value[rows, None])


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


def term_of(factors: Sequence[PatternVariable]) -> str:
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


def _scaled(v: PatternVariable) -> str:
    if v.family == "direction":
        return v.name
    if v.centre == 0.0:
        return f"({v.name}/{v.scale:.6g})"
    sign = "-" if v.centre > 0.0 else "+"
    return f"(({v.name} {sign} {abs(v.centre):.6g})/{v.scale:.6g})"


def _product_form(names: Sequence[str], squared: set[str]) -> str:
    parts = [f"{n}²" if n in squared else n for n in names]
    return "proportional to " + parts[0] if len(parts) == 1 else "product of " + " and ".join(parts)
