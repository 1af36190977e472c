"""Bounds of a formula's value, slopes and curvatures over boxes of its variables.

Samples cannot show that nothing lies between them; bounds can. Value, first and second derivatives
are carried through the formula together, each as an interval
(`abbe.compcore.effects.expressions.interval`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects.expressions.expression import FormulaNode
from abbe.compcore.effects.expressions.interval import (
    EVERYTHING,
    ZERO,
    Interval,
    cosine,
    power,
    reciprocal,
    roots,
    sine,
    tangent,
)

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ExpressionBounds:
    """Bounds of an expression over many boxes.

    Attributes
    ----------
    value
        Its value.
    slope, curvature
        Variable → first and second derivative along it; 0 along what is not named.
    """

    value: Interval
    slope: Mapping[str, Interval] = field(default_factory=dict)
    curvature: Mapping[str, Interval] = field(default_factory=dict)

    def __add__(self, other: ExpressionBounds) -> ExpressionBounds:
        return ExpressionBounds(
            self.value + other.value,
            {k: self.along(k)[0] + other.along(k)[0] for k in self._with(other)},
            {k: self.along(k)[1] + other.along(k)[1] for k in self._with(other)},
        )

    def __mul__(self, other: ExpressionBounds) -> ExpressionBounds:
        slope, curvature = {}, {}
        for k in self._with(other):
            (a, aa), (b, bb) = self.along(k), other.along(k)
            slope[k] = a * other.value + self.value * b
            curvature[k] = aa * other.value + (a * b).scaled(2.0) + self.value * bb
        return ExpressionBounds(self.value * other.value, slope, curvature)

    def __neg__(self) -> ExpressionBounds:
        return self * ExpressionBounds(Interval.of(-1.0))

    def along(self, name: str) -> tuple[Interval, Interval]:
        """First and second derivative along a variable."""
        return self.slope.get(name, ZERO), self.curvature.get(name, ZERO)

    def of(self, value: Interval, first: Interval, second: Interval) -> ExpressionBounds:
        """A function of this expression, given its value and its two derivatives here."""
        slope = {k: first * own for k, own in self.slope.items()}
        curvature = {
            k: second * power(own, 2.0) + first * self.along(k)[1] for k, own in self.slope.items()
        }
        return ExpressionBounds(value, slope, curvature)

    def _with(self, other: ExpressionBounds) -> dict[str, None]:
        return dict.fromkeys((*self.slope, *other.slope))


Box = Mapping[str, Interval]
"""Position, direction, time or reference by name; signal by ``signal NAME``, a lagged one alike."""


def signal_key(name: str) -> str:
    """What a box calls a signal, lagged or not."""
    return f"signal {name}"


def bounds(node: FormulaNode, box: Box, along: frozenset[str]) -> ExpressionBounds:
    """Bounds of a formula over boxes, with derivatives along some of its variables."""
    if node.what == "number":
        return ExpressionBounds(Interval.of(node.number))
    if node.what == "variable":
        value = box[node.name]
        if node.name not in along:
            return ExpressionBounds(value)
        return ExpressionBounds(value, {node.name: Interval.of(1.0)}, {node.name: ZERO})
    if node.what in ("signal", "lag"):
        return ExpressionBounds(box[signal_key(node.name)])
    parts = [bounds(part, box, along) for part in node.parts]
    if node.what == "negative":
        return -parts[0]
    if node.what == "Add":
        return parts[0] + parts[1]
    if node.what == "Sub":
        return parts[0] + (-parts[1])
    if node.what == "Mult":
        return parts[0] * parts[1]
    if node.what == "Div":
        return parts[0] * _to_the(parts[1], -1.0)
    if node.what == "power":
        return _to_the(parts[0], node.number)
    if node.what in ("min", "max"):
        found = parts[0]
        for part in parts[1:]:
            found = _one_of(found, part, node.what == "max")
        return found
    return _function(node.what, parts[0])


def summands(node: FormulaNode) -> Iterator[FormulaNode]:
    """Expressions of which it is the sum, each perhaps of the other sign."""
    if node.what in ("Add", "Sub"):
        for part in node.parts:
            yield from summands(part)
    elif node.what == "negative":
        yield from summands(node.parts[0])
    else:
        yield node


def factors(node: FormulaNode) -> list[FormulaNode]:
    """Expressions of which it is the product, each perhaps of the other sign."""
    if node.what == "negative":
        return factors(node.parts[0])
    if node.what == "Mult":
        return [*factors(node.parts[0]), *factors(node.parts[1])]
    if node.what == "Div":
        below = [
            FormulaNode("power", part.dimension.to_the(Fraction(-1)), (part,), number=-1.0)
            for part in factors(node.parts[1])
        ]
        return [*factors(node.parts[0]), *below]
    return [node]


def _to_the(x: ExpressionBounds, exponent: float) -> ExpressionBounds:
    v = x.value
    first = power(v, exponent - 1.0).scaled(exponent) if exponent else ZERO
    factor = exponent * (exponent - 1.0)
    second = power(v, exponent - 2.0).scaled(factor) if factor else ZERO
    return x.of(power(v, exponent), first, second)


def _function(name: str, x: ExpressionBounds) -> ExpressionBounds:
    v = x.value
    if name == "sin":
        return x.of(sine(v), cosine(v), -sine(v))
    if name == "cos":
        return x.of(cosine(v), -sine(v), -cosine(v))
    if name == "tan":
        value = tangent(v)
        first = Interval.of(1.0) + power(value, 2.0)
        return x.of(value, first, (value * first).scaled(2.0))
    if name == "exp":
        value = v.rising(np.exp)
        return x.of(value, value, value)
    if name == "log":
        above = Interval.of(1.0).where(v.low > 0.0, EVERYTHING)
        inverse = reciprocal(v)
        return x.of(roots(v, np.log) * above, inverse * above, -power(inverse, 2.0) * above)
    if name == "sqrt":
        return _to_the(x, 0.5)
    turns = v.contains_zero()
    sign = Interval.of(np.where(turns, -1.0, np.sign(v.low)), np.where(turns, 1.0, np.sign(v.high)))
    bent = EVERYTHING.where(turns, ZERO)
    if name == "sign":
        return x.of(sign, bent, bent)
    size = Interval.of(np.where(turns, 0.0, np.minimum(abs(v.low), abs(v.high))), v.largest)
    return x.of(size, sign, bent)


def _one_of(a: ExpressionBounds, b: ExpressionBounds, greater: bool) -> ExpressionBounds:
    """The lesser or the greater of two."""
    first = a.value.low >= b.value.high if greater else a.value.high <= b.value.low
    second = b.value.low >= a.value.high if greater else b.value.high <= a.value.low
    chosen = np.maximum if greater else np.minimum
    value = Interval(chosen(a.value.low, b.value.low), chosen(a.value.high, b.value.high))

    def pick(one: Interval, two: Interval, either: Interval) -> Interval:
        return one.where(np.asarray(first), two.where(np.asarray(second), either))

    slope, curvature = {}, {}
    for k in dict.fromkeys((*a.slope, *b.slope)):
        (one, one_bent), (two, two_bent) = a.along(k), b.along(k)
        slope[k] = pick(one, two, one.hull(two))
        curvature[k] = pick(one_bent, two_bent, EVERYTHING)
    return ExpressionBounds(value, slope, curvature)
