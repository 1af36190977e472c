"""The controller's own state: that it lives, whether its positions count, of when they are.

Pure: samples and the present time in, reasons and moments out. All times are monotonic, in s; a
sample's time is when its question left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from abbe.compcore.units import in_digits
from abbe.daemon.pipeline.reading.poll import Batch, Channel
from abbe.drivers.link import Quality

_GOOD = Quality.GOOD
_FORGET = 600.0
"""s for which a device's clock is compared with ours: in that time quartz drifts by some ms."""


@dataclass(slots=True)
class Beat:
    """A number that changes: a heartbeat, a sample number.

    Attributes
    ----------
    value
        Its last value; NaN before the first.
    since
        Earliest moment at which it can have come to have that value: just after the look that
        showed another one. At the first look, that look.
    """

    value: float = math.nan
    since: float = -math.inf
    _looked: float = math.nan

    def take(self, value: float, time: float) -> None:
        """Take in a reading whose question left at `time`."""
        if value != self.value:
            self.since = self._looked if self.value == self.value else time
            self.value = value
        self._looked = time


@dataclass(slots=True)
class DeviceClock:
    """A device's own clock beside ours: when a stamp of it was, at the latest.

    The answer to a question cannot be younger than its arrival; so of all answers the one that
    arrived soonest after its stamp tells how the clocks differ.
    """

    _best: float = math.inf
    _best_before: float = math.inf
    _turn: float = -math.inf
    _last: float = -math.inf

    def moment(self, stamp: float, arrived: float) -> float:
        """Our time of a device's stamp (s on its clock), which arrived at `arrived`."""
        if stamp < self._last:
            # set back, or begun anew: what was known of it holds no more
            self._best = self._best_before = math.inf
        self._last = stamp
        if arrived - self._turn > _FORGET:
            self._best_before, self._best, self._turn = self._best, math.inf, arrived
        self._best = min(self._best, arrived - stamp)
        return stamp + min(self._best, self._best_before)


@dataclass(slots=True)
class Watch:
    """The watch over the controller's own registers: whether its positions count.

    Attributes
    ----------
    stale_after
        s after which what guards a position is too old, as the position itself is.
    heartbeat, within
        A number that changes while the controller lives, and the longest time (s) in which it
        may stand still.
    status, require, forbid
        Status word, its bits that must be 1 and those that must be 0.
    sample
        A number that changes with every new sample of the positions.
    clock, tick
        The device's time stamp of the positions, and what it counts, s.
    """

    stale_after: float = 0.2
    heartbeat: Channel | None = None
    within: float = 1.0
    status: Channel | None = None
    require: int = 0
    forbid: int = 0
    sample: Channel | None = None
    clock: Channel | None = None
    tick: float = 1.0
    _beat: Beat = field(default_factory=Beat, init=False)
    _number: Beat = field(default_factory=Beat, init=False)
    _device: DeviceClock = field(default_factory=DeviceClock, init=False)

    @property
    def channels(self) -> tuple[Channel | None, ...]:
        """What is read for it."""
        return self.heartbeat, self.status, self.sample, self.clock

    def fault(self, batch: Batch, now: float) -> str:
        """Why positions cannot be believed at `now`; empty when they can."""
        if self.heartbeat is not None:
            link, channel = self.heartbeat
            sample = batch[link][channel]
            if sample.quality is not _GOOD:
                return f"controller's heartbeat: {sample.reason}"
            self._beat.take(sample.value, sample.time)
            if now - self._beat.since > self.within:
                return "the controller's heartbeat stands still"
            if now - sample.time > self.within:
                return f"controller's heartbeat: read {in_digits(now - sample.time, 2)} s ago"
        if self.status is not None:
            link, channel = self.status
            sample = batch[link][channel]
            if sample.quality is not _GOOD:
                return f"controller's status word: {sample.reason}"
            if now - sample.time > self.stale_after:
                return f"controller's status word: read {in_digits(now - sample.time, 2)} s ago"
            word = int(sample.value)
            if missing := self.require & ~word:
                return f"the controller's status word lacks {_bits(missing)}"
            if wrong := self.forbid & word:
                return f"the controller's status word has {_bits(wrong)}"
        return ""

    def taken(self, batch: Batch, now: float) -> tuple[float, str]:
        """Latest moment at which the device can have taken its positions, and why it is unknown.

        Infinity where the device does not say; the question's own moment holds then.
        """
        latest = math.inf
        if self.sample is not None:
            link, channel = self.sample
            sample = batch[link][channel]
            if sample.quality is not _GOOD:
                return latest, f"controller's sample number: {sample.reason}"
            self._number.take(sample.value, sample.time)
            latest = self._number.since
        if self.clock is not None:
            link, channel = self.clock
            sample = batch[link][channel]
            if sample.quality is not _GOOD:
                return latest, f"controller's time stamp: {sample.reason}"
            latest = min(latest, self._device.moment(sample.value * self.tick, now))
        return latest, ""


def _bits(mask: int) -> str:
    return "bit " + ", ".join(str(i) for i in range(16) if mask >> i & 1)
