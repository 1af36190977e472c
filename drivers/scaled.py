"""Scale, offset and unit of a channel: a number that stands for a value, alike in all links."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated

from pydantic import AfterValidator, BaseModel


def _not_zero(scale: float) -> float:
    if scale == 0.0:
        raise ValueError("scale is 0: every reading would be the same")
    return scale


Scale = Annotated[float, AfterValidator(_not_zero)]
"""A factor that can be taken back."""


class ScaledNumber(BaseModel):
    """Base of a channel's section: value = number · scale + offset, in `unit`."""

    scale: Scale = 1.0
    """value = number · scale + offset, in `unit`."""
    offset: float = 0.0
    unit: str | None = ""
    """Unit of the value, for people."""

    @property
    def value_of(self) -> Callable[[float], float]:
        """The function number → the value, in `unit`, that it stands for."""
        # a live cycle calls it for every channel: it looks nothing up
        scale, offset = self.scale, self.offset
        return lambda number: number * scale + offset

    @property
    def number_of(self) -> Callable[[float], float]:
        """The function value in `unit` → the number that stands for it."""
        scale, offset = self.scale, self.offset
        return lambda value: (value - offset) / scale

    @staticmethod
    def values_of(channels: Sequence[ScaledNumber]) -> Callable[[Sequence[float]], list[float]]:
        """The function numbers of several channels → their values, each as by `value_of`."""
        scales = tuple((c.scale, c.offset) for c in channels)
        return lambda numbers: [
            number * scale + offset for number, (scale, offset) in zip(numbers, scales, strict=True)
        ]

    def range_of(self, low: float, high: float) -> tuple[float, float]:
        """Smallest and largest value, of the smallest and largest number."""
        one, other = self.value_of(low), self.value_of(high)
        return min(one, other), max(one, other)

    @property
    def scaling(self) -> tuple[str, ...]:
        """``× 0.1 + 20``, for people; nothing where the number is the value."""
        if (self.scale, self.offset) == (1.0, 0.0):
            return ()
        return (f"× {self.scale:g}" + (f" + {self.offset:g}" if self.offset else ""),)


UNSCALED = ScaledNumber()
"""The number is the value."""
