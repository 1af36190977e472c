"""Oscillations in time and along axes, over a grid of periods, growing along an axis or not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.uncatalogued.patterns.pattern import (
    CandidatePattern,
    PatternGroup,
    Rows,
    Wave,
)
from abbe.compcore.diagnosis.uncatalogued.patterns.variables import PatternVariable, term_of
from abbe.compcore.effects.base import ErrorMotion
from abbe.compcore.sentences import said
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_FINE, _COARSE = 0.25, 0.5
"""Steps of frequency, as parts of the resolution 1/span."""


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
    size = _readable(period, v.unit)
    form = said("oscillation in {what} with a period of {size}", what=v.name, size=size)
    if along is not None:
        form = said("{oscillation}, growing along {axis}", oscillation=form, axis=along.name)
    if harmonics > 1:
        form = said("{oscillation}, not a sine", oscillation=form)
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


def period_grid(shortest: float, longest: float, step: float) -> F64:
    """Periods whose frequencies lie `step` apart."""
    if not 0.0 < shortest < longest:
        return np.zeros(0)
    return np.asarray(1.0 / np.arange(1.0 / longest, 1.0 / shortest, step))


def _readable(period: float, unit: str) -> str:
    if unit == "s" and period >= 120.0:
        return f"{in_digits(period / 60.0)} min"
    return f"{in_digits(period)} {unit}"
