"""Interval arithmetic: bounds of an expression while its variables stay between two ends.

Ends are arrays, one entry for each of many boxes. Rounding is not directed outward: bounds hold to
some 1e-12 of the largest number on the way, far below what they are asked for. Where nothing is
known (a division by what may be 0, the root of what may be negative) an interval is infinite.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Interval:
    """All numbers from `low` to `high`, arrays that broadcast; NaN becomes everything."""

    low: F64
    high: F64

    @classmethod
    def of(cls, low: ArrayLike, high: ArrayLike | None = None) -> Interval:
        """The interval between two ends, or one number."""
        a = np.asarray(low, dtype=np.float64)
        b = a if high is None else np.asarray(high, dtype=np.float64)
        unknown = np.isnan(a) | np.isnan(b)
        if unknown.any():
            a, b = np.where(unknown, -np.inf, a), np.where(unknown, np.inf, b)
        return cls(a, b)

    @property
    def width(self) -> F64:
        """Length; infinite where an end is."""
        with np.errstate(invalid="ignore"):
            found = self.high - self.low
        return np.where(np.isnan(found), np.inf, found)

    @property
    def largest(self) -> F64:
        """Greatest absolute value."""
        return np.maximum(np.abs(self.low), np.abs(self.high))

    def __add__(self, other: Interval) -> Interval:
        with np.errstate(all="ignore"):
            return Interval.of(self.low + other.low, self.high + other.high)

    def __neg__(self) -> Interval:
        return Interval(-self.high, -self.low)

    def __sub__(self, other: Interval) -> Interval:
        return self + (-other)

    def __mul__(self, other: Interval) -> Interval:
        with np.errstate(all="ignore"):
            ends = [_times(a, b) for a in (self.low, self.high) for b in (other.low, other.high)]
        return Interval.of(np.minimum.reduce(ends), np.maximum.reduce(ends))

    def scaled(self, factor: float) -> Interval:
        """The interval times a number."""
        return self * Interval.of(factor)

    def contains_zero(self) -> NDArray[np.bool_]:
        """Where 0 lies in it."""
        return np.asarray((self.low <= 0.0) & (self.high >= 0.0))

    def rising(self, function: Callable[[F64], F64]) -> Interval:
        """What a function that rises throughout makes of it."""
        with np.errstate(all="ignore"):
            return Interval.of(function(self.low), function(self.high))

    def hull(self, other: Interval) -> Interval:
        """The least interval that holds both."""
        return Interval(np.minimum(self.low, other.low), np.maximum(self.high, other.high))

    def taken(self, mask: NDArray[np.bool_]) -> Interval:
        """Those of many boxes for which the mask holds."""
        return Interval(self.low[mask], self.high[mask])

    def where(self, mask: NDArray[np.bool_], other: Interval) -> Interval:
        """This one where the mask holds, the other elsewhere."""
        return Interval(np.where(mask, self.low, other.low), np.where(mask, self.high, other.high))


EVERYTHING = Interval(np.asarray(-np.inf), np.asarray(np.inf))
ZERO = Interval.of(0.0)


def _times(a: F64, b: F64) -> F64:
    # an end is a limit: 0 times what grows without one is 0
    product = a * b
    return np.where((a == 0.0) | (b == 0.0), 0.0, product)


def power(x: Interval, exponent: float) -> Interval:
    """An interval to the power of a number."""
    if exponent == 0.0:
        return Interval.of(np.ones_like(x.low))
    if exponent < 0.0:
        return reciprocal(power(x, -exponent))
    if not exponent.is_integer():
        return roots(x, lambda v: v**exponent)
    if exponent % 2.0 == 1.0:
        return x.rising(lambda v: v**exponent)
    with np.errstate(all="ignore"):
        ends = x.low**exponent, x.high**exponent
    least = np.where(x.contains_zero(), 0.0, np.minimum(*ends))
    return Interval.of(least, np.maximum(*ends))


def reciprocal(x: Interval) -> Interval:
    """1/x; everything where x may be 0."""
    with np.errstate(all="ignore"):
        found = Interval.of(1.0 / x.high, 1.0 / x.low)
    return EVERYTHING.where(x.contains_zero(), found)


def roots(x: Interval, function: Callable[[F64], F64]) -> Interval:
    """A rising function that has no value below 0; everything where x may be negative."""
    return EVERYTHING.where(x.low < 0.0, x.rising(function))


def sine(x: Interval) -> Interval:
    """Sine of an angle, rad."""
    return cosine(x - Interval.of(0.5 * math.pi))


def cosine(x: Interval) -> Interval:
    """Cosine of an angle, rad: its ends, and 1 or −1 where a crest or a trough lies between."""
    with np.errstate(all="ignore"):
        ends = np.cos(x.low), np.cos(x.high)
        crest = np.floor(x.high / (2.0 * math.pi)) >= np.ceil(x.low / (2.0 * math.pi))
        shifted = x.low / (2.0 * math.pi) - 0.5, x.high / (2.0 * math.pi) - 0.5
        trough = np.floor(shifted[1]) >= np.ceil(shifted[0])
        far = ~(np.isfinite(x.low) & np.isfinite(x.high))
        low = np.where(trough | far, -1.0, np.minimum(*ends))
        high = np.where(crest | far, 1.0, np.maximum(*ends))
    return Interval(low, high)


def tangent(x: Interval) -> Interval:
    """Tangent of an angle, rad; everything where a pole lies between."""
    with np.errstate(all="ignore"):
        turns = x.low / math.pi - 0.5, x.high / math.pi - 0.5
        pole = ~(np.floor(turns[1]) < np.ceil(turns[0]))
    return EVERYTHING.where(pole, x.rising(np.tan))
