"""Convert: samples → positions and signals in the model's units, each fresh and good or named.

Pure: samples and the present time in, numbers and reasons out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite

from daemon.pipeline.poll import Batch, Channel
from drivers.link import Quality, Sample
from drivers.transducers import Transducer

_GOOD = Quality.GOOD
_MISSING = Sample(math.nan, -math.inf, Quality.UNAVAILABLE, "not read")


@dataclass(frozen=True, slots=True)
class Source:
    """One channel and what it becomes.

    Attributes
    ----------
    name
        Axis or signal.
    channel
        Where it is read.
    transducer
        What converts it, None where the channel is in the right unit already.
    """

    name: str
    channel: Channel
    transducer: Transducer | None = None

    def take(self, batch: Mapping[str, Mapping[str, Sample]]) -> Sample:
        """The sample of this source in a batch, converted."""
        link, channel = self.channel
        sample = batch.get(link, _NOTHING).get(channel, _MISSING)
        if self.transducer is None:
            return sample
        return self.transducer.convert(sample)


_NOTHING: Mapping[str, Sample] = {}


@dataclass(slots=True)
class Watch:
    """Tells from the controller's own registers whether its positions mean something.

    Attributes
    ----------
    heartbeat, within
        A number that changes while the controller lives, and the longest time (s) in which it
        may stand still.
    status, require, forbid
        Status word, its bits that must be 1 and those that must be 0.
    """

    heartbeat: Channel | None = None
    within: float = 1.0
    status: Channel | None = None
    require: int = 0
    forbid: int = 0
    _beat: float = field(default=math.nan, init=False)
    _since: float = field(default=-math.inf, init=False)

    def fault(self, batch: Batch, now: float) -> str:
        """Why positions cannot be believed at `now` (monotonic, s); empty when they can."""
        if self.heartbeat is not None:
            link, channel = self.heartbeat
            sample = batch[link][channel]
            if sample.quality is not _GOOD:
                return f"controller's heartbeat: {sample.reason}"
            if sample.value != self._beat:
                self._beat, self._since = sample.value, now
            elif now - self._since > self.within:
                return "the controller's heartbeat stands still"
        if self.status is not None:
            link, channel = self.status
            sample = batch[link][channel]
            if sample.quality is not _GOOD:
                return f"controller's status word: {sample.reason}"
            word = int(sample.value)
            if missing := self.require & ~word:
                return f"the controller's status word lacks {_bits(missing)}"
            if wrong := self.forbid & word:
                return f"the controller's status word has {_bits(wrong)}"
        return ""


def _bits(mask: int) -> str:
    return "bit " + ", ".join(str(i) for i in range(16) if mask >> i & 1)


class PositionConverter:
    """Axes' samples → positions, in the order of the axes.

    Parameters
    ----------
    sources
        One for each axis.
    stale_after
        s after which a sample counts as stale.
    watch
        What the controller says of itself.
    """

    def __init__(self, sources: Sequence[Source], stale_after: float, watch: Watch) -> None:
        self._sources = tuple(sources)
        self._steps = tuple(
            (s.name, *s.channel, None if s.transducer is None else s.transducer.convert)
            for s in sources
        )
        self._stale_after = stale_after
        self._watch = watch

    def __call__(self, batch: Batch, now: float) -> tuple[list[float], dict[str, str]]:
        """Positions (mm; rotary: rad; NaN where not to be believed), and why not, by axis.

        Encoders that follow their count see every sample, also those that are not used.
        """
        positions: list[float] = []
        faults: dict[str, str] = {}
        oldest = now - self._stale_after
        for name, link, channel, convert in self._steps:
            sample = batch.get(link, _NOTHING).get(channel, _MISSING)
            if convert is not None:
                sample = convert(sample)
            value, time, quality, _ = sample
            if quality is _GOOD and time >= oldest and isfinite(value):
                positions.append(value)
            else:
                positions.append(math.nan)
                faults[name] = _why(sample, now)
        if problem := self._watch.fault(batch, now):
            for i, source in enumerate(self._sources):
                positions[i] = math.nan
                faults.setdefault(source.name, problem)
        return positions, faults


@dataclass(frozen=True, slots=True)
class SignalReading:
    """One signal as it is shown and used.

    Attributes
    ----------
    value
        Last good value, in the signal's unit; NaN before the first.
    fault
        Why it is not fresh and good; empty when it is.
    time
        Monotonic time of the value, s; −inf before the first.
    """

    value: float = math.nan
    fault: str = ""
    time: float = -math.inf


class SignalConverter:
    """Signals' samples → readings that keep their last good value.

    Parameters
    ----------
    sources
        One for each signal.
    stale_after
        s after which a value counts as stale. A device that does not answer for less than that
        is no fault; one that answers with a broken sensor is one at once.
    """

    def __init__(self, sources: Sequence[Source], stale_after: float) -> None:
        self._sources = tuple(sources)
        self._stale_after = stale_after
        self.readings: Mapping[str, SignalReading] = {s.name: SignalReading() for s in sources}
        """By signal; replaced as a whole at every call."""

    def __call__(self, batch: Batch, now: float) -> Mapping[str, SignalReading]:
        """Take a batch in; the readings at `now` (monotonic, s)."""
        fresh: dict[str, SignalReading] = {}
        for source in self._sources:
            sample = source.take(batch)
            held = self.readings[source.name]
            if (
                sample.quality is _GOOD
                and now - sample.time <= self._stale_after
                and isfinite(sample.value)
            ):
                held = SignalReading(sample.value, "", sample.time)
            elif sample.quality is not Quality.UNAVAILABLE or now - held.time > self._stale_after:
                held = SignalReading(held.value, _why(sample, now), held.time)
            fresh[source.name] = held
        self.readings = fresh
        return fresh


class ToolConverter:
    """Three channels → the tool's offset, as the controller knows it.

    Parameters
    ----------
    channels
        Of x, y, z in mm; empty where the offset is fixed.
    stale_after
        s after which the last offset counts as stale: the tool may have been changed.

    Attributes
    ----------
    fault
        Why the tool's offset is not known; empty when it is, or is fixed.
    """

    def __init__(self, channels: Sequence[Channel], stale_after: float) -> None:
        self._channels = tuple(channels)
        self._stale_after = stale_after
        self._read_at = -math.inf
        self.fault = "not read yet" if self._channels else ""

    def __call__(self, batch: Batch, now: float) -> tuple[float, float, float] | None:
        """The offset (mm) where it was read now; `now` is monotonic, s."""
        if not self._channels:
            return None
        samples = [batch.get(link, _NOTHING).get(name, _MISSING) for link, name in self._channels]
        bad = [s for s in samples if s.quality is not _GOOD or not isfinite(s.value)]
        if bad:
            unknown = bad[0].quality is not Quality.UNAVAILABLE
            if unknown or now - self._read_at > self._stale_after:
                self.fault = _why(bad[0], now)
            return None
        self._read_at, self.fault = min(s.time for s in samples), ""
        x, y, z = (s.value for s in samples)
        return x, y, z


def _why(sample: Sample, now: float) -> str:
    if sample.quality is not _GOOD:
        return sample.reason or sample.quality.value
    if not isfinite(sample.value):
        return f"not a number: {sample.value}"
    return f"stale: {now - sample.time:.2g} s old"
