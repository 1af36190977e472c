"""The shop's air and what it does to the machine's places: in closed form, at any time.

The ambient temperature is a base, any number of ramps and a swing; every place follows it as a
first-order lag with its own time constant and offset, so all of them drift differently. No
integration: the temperature at any shop time is a formula, the same however often it is asked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Ramp:
    """The ambient temperature changes by `rise` K, evenly from `start` for `duration` s."""

    start: float
    duration: float
    rise: float


@dataclass(frozen=True)
class SensorPlace:
    """A place with a temperature sensor.

    Attributes
    ----------
    name
        Its signal's name.
    lag
        Time constant with which it follows the ambient air, s.
    offset
        How much warmer than the ambient air it is in the long run, K (motors, lamps).
    """

    name: str
    lag: float
    offset: float


@dataclass(frozen=True)
class Climate:
    """Temperatures of all places over shop time.

    Attributes
    ----------
    places
        In the order of the answers.
    base
        Ambient temperature before any ramp, °C.
    ramps
        Changes of the ambient temperature.
    swing, period
        Amplitude (K) and period (s) of the air conditioning's cycle, long settled at time 0.
    """

    places: tuple[SensorPlace, ...]
    base: float
    ramps: Sequence[Ramp] = ()
    swing: float = 0.0
    period: float = 3600.0

    def __call__(self, time: ArrayLike) -> Array:
        """Temperatures (°C) of all places at shop times (...) in s: shape (..., places)."""
        t = np.asarray(time, dtype=float)[..., None]
        lag = np.array([place.lag for place in self.places])
        omega = 2.0 * math.pi / self.period
        out: Array = (
            self.base + np.array([place.offset for place in self.places]) + np.zeros_like(t)
        )
        out = out + self.swing / np.hypot(1.0, omega * lag) * np.sin(
            omega * t - np.arctan(omega * lag)
        )
        for ramp in self.ramps:
            # A ramp that ends is one that goes on, and another downwards from its end.
            rate = ramp.rise / ramp.duration
            out = out + rate * (
                _lagged_ramp(t - ramp.start, lag)
                - _lagged_ramp(t - ramp.start - ramp.duration, lag)
            )
        return out


def _lagged_ramp(t: Array, lag: Array) -> Array:
    """Answer of a first-order lag to max(0, t): t − τ (1 − exp(−t/τ))."""
    on = np.maximum(t, 0.0)
    return on + lag * np.expm1(-on / lag)
