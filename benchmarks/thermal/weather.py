"""A week of a workshop: air, doors, sun, work of the spindle, coolant, hydraulics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.thermal.bodies import Weather

F64 = NDArray[np.float64]

HOUR = 3600.0
DAY = 24 * HOUR
STEP = 30.0

TOP_SPEED = 12_000.0
"""Spindle, rpm."""


@dataclass(frozen=True)
class Shop:
    """What happens in a workshop; each on or off.

    Attributes
    ----------
    swing
        By how much the air swings through a day, K to either side.
    doors
        How often a day a door stands open for some minutes.
    sun, spindle, coolant, pump
        Whether there is sun on the column, work of the spindle, flowing coolant, hydraulics.
    before_work
        Whether the spindle works in the hour before the first reading too.
    """

    swing: float = 0.3
    doors: int = 0
    sun: bool = False
    spindle: bool = False
    coolant: bool = False
    pump: bool = False
    before_work: bool = False


@dataclass(frozen=True, eq=False)
class Week:
    """The weather of several days, and the spindle's speed with it.

    Attributes
    ----------
    time
        Shape (n,), s from midnight before the first day.
    weather
        What the bodies feel.
    speed
        Of the spindle, rpm, shape (n,).
    """

    time: F64
    weather: Weather
    speed: F64


FIRST, LAST = 7 * HOUR, 17 * HOUR
"""When readings begin and end, s after midnight."""


def week(shop: Shop, days: int, rng: np.random.Generator) -> Week:
    """Some days of a workshop; each is another one than the day before."""
    time = np.arange(0.0, days * DAY, STEP)
    of_day = time % DAY
    number = (time // DAY).astype(int)
    air = 21.0 + _wander(len(time), 18 * HOUR, 0.4, rng)
    swing = shop.swing * rng.uniform(0.6, 1.4, days)[number]
    late = rng.uniform(-1.0, 1.0, days)[number] * HOUR
    air = air + swing * np.sin(2 * np.pi * (of_day - late - 9.5 * HOUR) / DAY)
    # a heater between two temperatures, and doors
    air += 0.1 * np.sin(2 * np.pi * time / (0.4 * HOUR) + rng.uniform(0, 6))
    air -= _doors(shop, days, time, rng)
    speed = _speed(shop, days, time, rng)
    spindle = 420.0 * (speed / TOP_SPEED) ** 1.4
    working = (of_day > FIRST - 0.5 * HOUR) & (of_day < LAST)
    flowing = np.zeros(len(time), dtype=bool)
    if shop.coolant:
        flowing = working & (_blocks(time, 1.5 * HOUR, days, rng) > 0.45)
    chiller = 1.2 * np.sign(np.sin(2 * np.pi * time / (0.9 * HOUR)))
    warmed = _lag(flowing * 5.0 + chiller, 0.6 * HOUR)
    coolant = air + warmed - 1.5
    high = np.clip(np.sin(np.pi * (of_day - 10.0 * HOUR) / (6.0 * HOUR)), 0.0, None)
    high[(of_day < 10 * HOUR) | (of_day > 16 * HOUR)] = 0.0
    clouds = np.clip(0.6 + _wander(len(time), 0.7 * HOUR, 0.5, rng), 0.0, 1.0)
    clouds *= rng.uniform(0.3, 1.0, days)[number]
    sun = (260.0 if shop.sun else 0.0) * high * clouds
    pump = (450.0 if shop.pump else 0.0) * working * (_blocks(time, 2 * HOUR, days, rng) > 0.35)
    return Week(time, Weather(STEP, air, coolant, flowing, spindle, sun, pump), speed)


def _speed(shop: Shop, days: int, time: F64, rng: np.random.Generator) -> F64:
    """Work in pieces of half an hour to an hour and a half, with pauses."""
    speed = np.zeros(len(time))
    if not shop.spindle:
        return speed
    for day in range(days):
        at = day * DAY + FIRST + (0.0 if not shop.before_work else -2.0 * HOUR)
        while at < day * DAY + LAST:
            end = at + rng.uniform(0.5, 1.6) * HOUR
            pause = not shop.before_work and rng.random() < 0.35
            value = 0.0 if pause else rng.uniform(0.25, 1.0) * TOP_SPEED
            if shop.before_work and at >= day * DAY + FIRST:
                value = 0.0 if rng.random() < 0.6 else value
            speed[(time >= at) & (time < end)] = value
            at = end
    return speed


def _doors(shop: Shop, days: int, time: F64, rng: np.random.Generator) -> F64:
    """How much colder the air is for a door that stands open, K."""
    open_ = np.zeros(len(time))
    for day in range(days):
        for _ in range(rng.poisson(shop.doors) if shop.doors else 0):
            at = day * DAY + rng.uniform(FIRST - HOUR, LAST)
            length = rng.uniform(4.0, 25.0) * 60.0
            open_[(time >= at) & (time < at + length)] = rng.uniform(3.0, 7.0)
    return _lag(open_, 9 * 60.0)


def _blocks(time: F64, mean: float, days: int, rng: np.random.Generator) -> F64:
    """A number between 0 and 1 that stays for a while and then is another."""
    out = np.empty(len(time))
    at = 0.0
    while at < days * DAY:
        end = at + rng.uniform(0.5, 1.5) * mean
        out[(time >= at) & (time < end)] = rng.random()
        at = end
    return out


def _wander(n: int, slow: float, size: float, rng: np.random.Generator) -> F64:
    """A signal that wanders about 0, with a standard deviation `size` and a memory of `slow` s."""
    stays = np.exp(-STEP / slow)
    kicks = rng.normal(0.0, size * np.sqrt(1.0 - stays**2), n)
    kicks[0] = rng.normal(0.0, size)
    out = np.empty(n)
    value = 0.0
    for k, kick in enumerate(kicks):
        value = stays * value + kick
        out[k] = value
    return out


def _lag(values: F64, tau: float) -> F64:
    """Air in a hall mixes within minutes: each step a part of the way."""
    part = 1.0 - np.exp(-STEP / tau)
    out = np.empty(len(values))
    state = 0.0
    for k, value in enumerate(values):
        state += part * (value - state)
        out[k] = state
    return out
