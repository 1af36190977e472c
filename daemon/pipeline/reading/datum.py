"""Datums: where an axis stands whose encoder does not know it, as a person says at the reference.

An incremental encoder counts from wherever it was switched on. Until somebody has said where the
axis stands (`abbe datum`), its position is not known and nothing is corrected; so again when its
device was away, because it may have begun to count anew.
"""

from __future__ import annotations

import asyncio
import math

from abbe.drivers.link import Quality, Sample
from abbe.drivers.transducers import Transducer
from abbe.drivers.transducers.base import SensorFaultError, TransducerFault

NOT_SET = "no datum: the axis's encoder is not absolute; abbe datum says where it stands"
_SAMPLES = 5
"""So many samples in a row must be alike while a datum is set."""
_LOOK = 0.01
_STILL = {"mm": 2e-3, "rad": 2e-5}
"""By how much they may differ."""


class Datum(Transducer):
    """An axis's position, counted from wherever it was switched on, and its datum.

    Parameters
    ----------
    inner
        What converts counts; None: the channel is in mm or rad.
    unit
        ``mm`` or ``rad``.
    """

    def __init__(self, inner: Transducer | None, unit: str) -> None:
        self._inner = inner
        self.unit = unit
        self.raw_unit = unit if inner is None else inner.raw_unit
        self._offset = math.nan
        self._wanted = math.nan
        self._alike: list[float] = []
        self._reconnects: int | None = None
        self._problem = NOT_SET

    @property
    def problem(self) -> str:
        """Why the position is not known; empty when it is."""
        return "" if self._offset == self._offset else self._problem

    @property
    def pending(self) -> bool:
        """Whether a datum was given and the axis is looked at whether it stands."""
        return self._wanted == self._wanted

    def set(self, position: float) -> None:
        """Say where the axis stands, mm or rad; it counts once some samples have been alike.

        Until then the position is not known, also where there was a datum before.
        """
        self._offset = math.nan
        self._wanted, self._alike, self._problem = position, [], "its datum is being set"

    async def settled(self) -> None:
        """Wait until no datum is being set any more."""
        while self.pending:  # noqa: ASYNC110  (samples come by themselves, a few milliseconds apart)
            await asyncio.sleep(_LOOK)

    def give_up(self, problem: str) -> None:
        """End the setting of a datum without one."""
        self._wanted, self._problem = math.nan, f"{problem}; {NOT_SET}"

    def see(self, reconnects: int) -> None:
        """Take note of how often its link has come back; once more, and the datum is lost."""
        if self._reconnects is not None and reconnects != self._reconnects:
            self._offset = self._wanted = math.nan
            self._problem = f"its device was away and may count anew: {NOT_SET}"
        self._reconnects = reconnects

    def value(self, raw: float) -> float:
        """Position, mm or rad; see `Transducer.value`."""
        counted = raw if self._inner is None else self._inner.value(raw)
        if self.pending:
            self._look(counted)
        if self._offset != self._offset:
            raise SensorFaultError(TransducerFault.NOT_REFERENCED, self._problem)
        return counted + self._offset

    def _look(self, counted: float) -> None:
        self._alike.append(counted)
        if max(self._alike) - min(self._alike) > _STILL[self.unit]:
            self._wanted, self._problem = math.nan, f"it moved while its datum was set; {NOT_SET}"
        elif len(self._alike) >= _SAMPLES:
            self._offset, self._wanted = self._wanted - counted, math.nan

    def inverse(self, value: float) -> float:
        """Raw number for a position; see `Transducer.inverse`."""
        if self._offset != self._offset:
            raise SensorFaultError(TransducerFault.NOT_REFERENCED, self._problem)
        counted = value - self._offset
        return counted if self._inner is None else self._inner.inverse(counted)

    def convert(self, raw: Sample) -> Sample:
        """Convert a sample; see `Transducer.convert`."""
        counted = raw if self._inner is None else self._inner.convert(raw)
        if counted.quality is not Quality.GOOD:
            return counted
        if self.pending:
            self._look(counted.value)
        if self._offset != self._offset:
            why = f"{TransducerFault.NOT_REFERENCED.value}: {self._problem}"
            return Sample(math.nan, counted.time, Quality.BAD, why)
        return Sample(counted.value + self._offset, counted.time)
