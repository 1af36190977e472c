"""Dimensions of quantities in formulas: products of powers of unit symbols."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

_SYMBOL = re.compile(r"([^\d/·*()\s²³-]+)(?:([²³])|(-?\d+))?")
_SAME = {"degC": "K", "µm": "um"}
_POWERS = {"²": 2, "³": 3}
_RAISED = {2: "²", 3: "³"}


@dataclass(frozen=True, slots=True)
class Dimension:
    """A product of powers of unit symbols.

    Attributes
    ----------
    powers
        (symbol, power), sorted by symbol; none: a pure number.
    free
        Whether a bare number took part: numbers in a formula carry whatever unit their place asks
        for, so that the whole may take any dimension.
    """

    powers: tuple[tuple[str, Fraction], ...] = ()
    free: bool = False

    @classmethod
    @lru_cache(maxsize=1024)  # asked for each name of each formula whenever a model is made
    def of(cls, unit: str) -> Dimension:
        """The dimension of a unit as a model file spells it; °C counts as K.

        >>> str(Dimension.of("mm/min")), str(Dimension.of("rad/(K·mm)")), str(Dimension.of("1"))
        ('mm/min', 'rad/(K·mm)', '1')
        """
        total: dict[str, Fraction] = {}
        above, *below = unit.split("/")
        for part, sign in [(above, 1), *((b, -1) for b in below)]:
            for symbol, raised, digits in _SYMBOL.findall(part):
                power = _POWERS.get(raised) or int(digits or 1)
                name = _SAME.get(symbol, symbol)
                total[name] = total.get(name, Fraction(0)) + sign * power
        return cls._from(total)

    @classmethod
    def _from(cls, total: Mapping[str, Fraction], free: bool = False) -> Dimension:
        return cls(tuple(sorted((k, p) for k, p in total.items() if p)), free)

    @property
    def pure(self) -> bool:
        """Whether it is a number without unit, or may be taken as one."""
        return not self.powers or self.free

    def times(self, other: Dimension, sign: int = 1) -> Dimension:
        """Of a product; with `sign` −1 of a quotient."""
        total = dict(self.powers)
        for symbol, power in other.powers:
            total[symbol] = total.get(symbol, Fraction(0)) + sign * power
        return self._from(total, self.free or other.free)

    def to_the(self, power: Fraction) -> Dimension:
        """Of a power."""
        return self._from({k: p * power for k, p in self.powers}, self.free)

    def joined(self, other: Dimension) -> Dimension | None:
        """Of a sum, or None where the two cannot be added."""
        if self.powers == other.powers:
            return Dimension(self.powers, self.free and other.free)
        if self.free:
            return other
        return self if other.free else None

    def __str__(self) -> str:
        above = [_text(k, p) for k, p in self.powers if p > 0]
        below = [_text(k, -p) for k, p in self.powers if p < 0]
        text = "·".join(above) or "1"
        if below:
            under = "·".join(below)
            text += f"/({under})" if len(below) > 1 or "/" in under else f"/{under}"
        return text


def _text(symbol: str, power: Fraction) -> str:
    if power == 1:
        return symbol
    return f"{symbol}{_RAISED.get(int(power), power) if power.denominator == 1 else f'^{power}'}"
