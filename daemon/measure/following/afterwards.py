"""What an instrument reads on at a target that was read: whether it goes on changing there.

A display that is late by seconds, or slow, shows the target before for that long, and steadily.
"""

from __future__ import annotations

import math

from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.daemon.config.sections.measure import MeasureSection
from abbe.daemon.measure.following.average import Averaging, SteadyReading
from abbe.daemon.measure.following.instrument import Instrument

_LONG = 10.0
"""s after a reading during which a change is the instrument's; later the machine may warm up."""
_SURE = 4.0
"""Standard deviations of scatter that a change has to be."""
_STATED = 2.0
"""Standard uncertainties of a reading that it has to be."""


class Afterwards:
    """Compares averages after a target was read with what was read.

    Parameters
    ----------
    limits
        When a reading counts.
    """

    def __init__(self, limits: MeasureSection) -> None:
        self._limits = limits
        self._read: SteadyReading | None = None
        self._until = -math.inf
        self._averaging = Averaging(0.0, limits.average)

    def begin(self, reading: SteadyReading, now: float) -> None:
        """Follow what comes after a reading; `now` is monotonic, s."""
        self._read, self._until = reading, now + _LONG
        self._averaging = Averaging(now, self._limits.average)

    def forget(self) -> None:
        """Follow nothing."""
        self._read = None

    def step(
        self,
        now: float,
        instrument: Instrument,
        setup: PlannedSetup,
        target: int,
        values: tuple[float, ...],
        positions: list[float],
    ) -> float:
        """Take a reading in; by how much it has changed since, mm or rad, where that is too much.

        0 otherwise.
        """
        read = self._read
        if read is None or now > self._until or not values:
            return 0.0
        self._averaging.add(instrument.time, values, positions)
        if not self._averaging.full(now):
            return 0.0
        after = self._averaging.result()
        self._averaging = Averaging(now, self._limits.average)
        unit = 1e-6 if instrument.angle else 1e-3
        most = max(self._limits.max_drift * unit, _STATED * instrument.sd(setup, target))
        worst = 0.0
        for k, (was, is_) in enumerate(zip(read.values, after.values, strict=True)):
            scatter = math.hypot(
                read.spreads[k] / math.sqrt(read.count), after.spreads[k] / math.sqrt(after.count)
            )
            if abs(is_ - was) > max(most, _SURE * scatter):
                worst = max(worst, abs(is_ - was))
        return worst
