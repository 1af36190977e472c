"""Degrees on the wire, radians inside: rotary axes whose channel, or transducer, is in degrees."""

from __future__ import annotations

import math

from abbe.drivers.link import Quality, Sample
from abbe.drivers.transducers.base import Transducer


class Degrees(Transducer):
    """An angle that arrives in degrees, and is written in degrees.

    Parameters
    ----------
    inner
        What gives degrees; None: the channel itself does.
    """

    unit = "rad"

    def __init__(self, inner: Transducer | None = None) -> None:
        self._inner = inner
        self.raw_unit = "deg" if inner is None else inner.raw_unit

    def value(self, raw: float) -> float:
        """Angle, rad."""
        return math.radians(raw if self._inner is None else self._inner.value(raw))

    def inverse(self, value: float) -> float:
        """Raw number for an angle, rad."""
        degrees = math.degrees(value)
        return degrees if self._inner is None else self._inner.inverse(degrees)

    def convert(self, raw: Sample) -> Sample:
        """Convert a sample; one that is not good passes with its quality and reason."""
        found = raw if self._inner is None else self._inner.convert(raw)
        if found.quality is not Quality.GOOD:
            return found
        return Sample(math.radians(found.value), found.time)
