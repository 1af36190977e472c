"""What thermometers read, without their noise and their steps: bodies warm slowly, readings do not.

A scale of 3 m makes 0.6 µm of 0.02 K, and 15 µm of a step of 0.5 K. Set-ups have their own zero, so
an expansion is seen by what a thermometer does within one, minutes; its noise there is as large as
that, and follows other thermometers' trends, shifts and lags as no body does. So a length is
multiplied by the straight line through the readings around it in time, over as long as foretells
each reading best from the others.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Unsteady
from abbe.compcore.campaign.resolution import of_step
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.sentences import Sentence, joined, said
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_FEWEST = 30
"""Readings of a stretch from which on their noise is known."""
_LEAST = 0.002
"""K: what scatters less moves no length by what anybody reads."""
_MOST = 0.1
"""K: no thermometer's noise is more; what changes by more from one reading to the next is so."""
_FAR = 5.0
"""Standard deviations of a thermometer's noise beyond which a reading is no noise."""
_MEDIAN = 0.6745
"""Median of what noise is off by, in its standard deviations."""
_JUMPS = 0.01
"""Part of the readings of a display that steps that may jump by more than a step."""
_COARSE = 0.05
"""K: of finer steps the noise says all."""
_COARSEST = 1.01
"""K: no display that anybody corrects by steps in more."""
_ZERO_F = 32.0 / 1.8
"""K from 0 °F to 0 °C."""
_OFTEN = 10
"""Readings for each different one from which on they step."""
_ROUNDED = 0.05
"""Part of a step by which rounding may put it off."""
_WIDER = math.sqrt(2.0)
"""By what one window is longer than the one before."""
_STEPS_LEFT = 1.1
"""Times the scatter of steps alone that a window may leave of readings that step."""


def steadied(campaign: Campaign, machine: Machine) -> Campaign:
    """The campaign with each thermometer's readings without their noise; asked twice, the same.

    Where nothing says when rows were measured, or few were, readings stay as they are.
    """
    return _steadied(campaign, machine)[0]


def unsteady(campaign: Campaign, machine: Machine) -> Mapping[str, Unsteady]:
    """Thermometers whose noise or steps `steadied` takes away, by name."""
    return _steadied(campaign, machine)[1]


def _steadied(campaign: Campaign, machine: Machine) -> tuple[Campaign, Mapping[str, Unsteady]]:
    if campaign.unsteady is not None:
        return campaign, campaign.unsteady
    conditions = campaign.conditions
    names = tuple(
        name
        for name in conditions.signals
        if name in machine.signals and machine.signals[name].temperature
    )
    if not names or not campaign.clocked:
        return campaign, {}
    steady, found = conditions.kept(("steadied", names), lambda: _made(conditions, names))
    return replace(campaign, conditions=steady, unsteady=found), found


def _made(
    conditions: Conditions, names: tuple[str, ...]
) -> tuple[Conditions, Mapping[str, Unsteady]]:
    signals, found = dict(conditions.signals), {}
    for name in names:
        values = conditions.signals[name]
        steady = values.copy()
        for one in np.unique(conditions.stretches):
            rows = np.flatnonzero(conditions.stretches == one)
            steady[rows] = steady_readings(conditions.time[rows], values[rows])
        scatter = float(np.sqrt(np.mean((values - steady) ** 2)))
        step = _step(values) if _follows(values, conditions.stretches, _step(values)) else 0.0
        if scatter > _LEAST and (step > 0.0 or scatter <= _MOST):
            signals[name] = steady
            found[name] = Unsteady(scatter, step)
    if not found:
        return conditions, {}
    return replace(conditions, signals=signals, _lags={}, _known=None), found


def _follows(values: F64, stretches: NDArray[np.int64], step: float) -> bool:
    """Whether readings go from one step of a display to the next, as what warms slowly does.

    Temperatures of a few runs may lie evenly apart as well; between those they jump.
    """
    jumps = np.abs(np.diff(values))[np.diff(stretches) == 0]
    return step > 0.0 and float(np.mean(jumps > 1.5 * step)) <= _JUMPS if len(jumps) else False


def _step(values: F64) -> float:
    """The step of a display, K, of whatever unit it steps in: 1 °F are 0.556 K; 0 where none is."""
    apart = np.diff(np.unique(np.round(values, 6)))
    step = float(apart.min(initial=math.inf))
    if not _COARSE <= step <= _COARSEST or len(apart) * _OFTEN > len(values):
        return 0.0
    # a display divides two degrees, from 0 °C or 0 °F on; temperatures that somebody chose may lie
    # evenly as well
    for degree, zero in ((1.0, 0.0), (1.0 / 1.8, _ZERO_F)):
        counted = np.append((values + zero) / step, 2.0 * degree / step)
        if float(np.abs(counted - np.rint(counted)).max()) < _ROUNDED:
            return step
    return 0.0


def steady_readings(time: F64, values: F64) -> F64:
    """What one thermometer's readings, (n,), K, at times (n,), s, of one stretch are without noise.

    The window is the one with the least generalised cross-validation (Craven, Wahba, Numerische
    Mathematik 31, 1979, 377). Readings that step do not scatter about what they read, so that would
    follow each step; there it is the longest that leaves no more than the steps by themselves.
    """
    if len(values) < _FEWEST or not np.isfinite(values).all() or float(np.ptp(values)) == 0.0:
        return values
    times, at = np.unique(time, return_inverse=True)
    at = at.reshape(-1)
    count = np.bincount(at).astype(np.float64)
    mean = np.bincount(at, weights=values) / count
    within = float(((values - mean[at]) ** 2).sum())
    gaps, span = np.diff(times), float(times[-1] - times[0])
    step = _step(values)
    n, best, steady = len(values), math.inf, values
    least = half = 1.5 * float(np.median(gaps)) if len(gaps) else span
    while half < 0.5 * span:
        line, leverage = _lines(times, mean, count, half)
        left = float((count * (mean - line) ** 2).sum()) + within
        share = min(float((count * leverage).sum()) / n, 1.0)
        score = left / n / max(1.0 - share, 1e-9) ** 2
        no_more = step > 0.0 and left <= n * (_STEPS_LEFT * of_step(step)) ** 2
        if no_more or score < best:
            best = -math.inf if no_more else score
            # what changes from one reading to the next is no noise
            steady = line[at] if half > least else values
        half *= _WIDER
    # a sensor that coolant hits, or that was moved, jumps: that is what it read
    apart = np.abs(values - steady)
    noise = step if step > 0.0 else _FAR * float(np.median(apart)) / _MEDIAN
    return np.where(apart > noise, values, steady)


def _lines(times: F64, mean: F64, count: F64, half: float) -> tuple[F64, F64]:
    """The straight lines through the readings within `half`, s, of each, and their leverages.

    `mean` and `count` of the readings at each of the times, (m,), sorted.
    """
    first = np.searchsorted(times, times - half, side="left")
    last = np.searchsorted(times, times + half, side="right")
    t = times - times.mean()
    y = mean - mean.mean()

    def over(each: F64) -> F64:
        total = np.concatenate([[0.0], np.cumsum(each)])
        return np.asarray(total[last] - total[first])

    s0, st, sy = over(count), over(count * t), over(count * y)
    middle = st / s0
    stt = np.maximum(over(count * t * t) - s0 * middle**2, 0.0)
    sty = over(count * t * y) - middle * sy
    lies = stt > 1e-9 * s0 * half**2
    slope = np.where(lies, sty / np.where(lies, stt, 1.0), 0.0)
    off = t - middle
    leverage = 1.0 / s0 + np.where(lies, off**2 / np.where(lies, stt, 1.0), 0.0)
    return sy / s0 + slope * off + mean.mean(), leverage


def unsteady_words(campaign: Campaign, machine: Machine) -> Iterator[Sentence]:
    """By what thermometers scattered, and which come in steps, with what that does to a scale."""
    found = campaign.unsteady or {}
    noisy = {name: u.scatter for name, u in found.items() if not u.step}
    if noisy:
        yield said(
            "thermometers were taken without their scatter from reading to reading, which no body "
            "follows: {names}",
            names=joined((f"{n} {in_digits(sd, 2)} K" for n, sd in noisy.items()), ", "),
        )
    for name, u in found.items():
        axis = machine.signals[name].axis
        if not u.step:
            continue
        half = 0.5 * u.step
        yield said(
            "{name} comes in steps of {step} K, so each reading is off by up to ±{half} K{length}. "
            "Here it was taken as the line through its readings; live nothing can: a finer "
            "thermometer is needed",
            name=name, step=in_digits(u.step, 3), half=in_digits(half, 3),
            length="" if axis is None else said(
                ": ±{um} µm at {end} mm of a scale of {axis} with 10 ppm/K",
                um=in_digits(_STEEL * half * _long(machine, axis) * 1e3, 2),
                end=f"{_long(machine, axis):.0f}", axis=axis,
            ),
        )  # fmt: skip


_STEEL = 10e-6
"""1/K: about what a scale of steel expands by."""


def _long(machine: Machine, axis: str) -> float:
    low, high = machine.axes[axis].travel
    return high - low
