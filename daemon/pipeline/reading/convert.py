"""Convert: samples → positions and signals in the model's units, each fresh and good or named.

Pure: samples and the present time in, numbers and reasons out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

from abbe.compcore.errors import InputError
from abbe.compcore.units import in_digits
from abbe.daemon.pipeline.reading.controller_watch import Watch
from abbe.daemon.pipeline.reading.plausible import Plausible
from abbe.daemon.pipeline.reading.poll import Batch, Channel
from abbe.drivers.link import Quality, Sample
from abbe.drivers.transducers import Transducer

_GOOD = Quality.GOOD
_MISSING = Sample(math.nan, -math.inf, Quality.UNAVAILABLE, "not read")


@dataclass(frozen=True, slots=True)
class ChannelSource:
    """One channel that is read, and its conversion.

    Attributes
    ----------
    name
        Axis or signal.
    channel
        Where it is read.
    transducer
        What converts it, None where the channel is in the right unit already.
    minus
        A channel that is taken off, of the same question; None: none.
    """

    name: str
    channel: Channel
    transducer: Transducer | None = None
    minus: Channel | None = None

    def take(self, batch: Mapping[str, Mapping[str, Sample]]) -> Sample:
        """The sample of this source in a batch, converted."""
        link, channel = self.channel
        sample = batch.get(link, _NOTHING).get(channel, _MISSING)
        if self.transducer is not None:
            sample = self.transducer.convert(sample)
        if self.minus is None or not sample.good:
            return sample
        link, channel = self.minus
        other = batch.get(link, _NOTHING).get(channel, _MISSING)
        if not other.good:
            return Sample(math.nan, sample.time, other.quality, other.reason)
        if other.time != sample.time:
            reason = f"not of the same question as {link}:{channel}"
            return Sample(math.nan, sample.time, Quality.UNAVAILABLE, reason)
        return Sample(sample.value - other.value, sample.time)


_NOTHING: Mapping[str, Sample] = {}


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
    ranges
        For each axis, the least and the greatest position that it can have, mm (rotary: rad).
    echoed
        Channels that are written back to say to which sample a corrected position belongs: they
        must be of the same question as the positions of their link.

    Attributes
    ----------
    taken_at
        Earliest moment (monotonic, s) at which any of the last positions can have been taken;
        infinity before the first.
    """

    def __init__(
        self,
        sources: Sequence[ChannelSource],
        stale_after: float,
        watch: Watch,
        ranges: Sequence[tuple[float, float]] = (),
        echoed: Sequence[Channel] = (),
    ) -> None:
        self._sources = tuple(sources)
        self._steps = tuple(
            (s.name, *s.channel, None if s.transducer is None else s.transducer.convert, *limits)
            for s, limits in zip(
                sources, ranges or [(-math.inf, math.inf)] * len(sources), strict=True
            )
        )
        self._stale_after = stale_after
        self._watch = watch
        self._dated = watch.sample is not None or watch.clock is not None
        self._echoed = tuple(
            (link, name, [i for i, s in enumerate(sources) if s.channel[0] == link])
            for link, name in echoed
        )
        self.taken_at = math.inf

    def __call__(self, batch: Batch, now: float) -> tuple[list[float], dict[str, str]]:
        """Positions (mm; rotary: rad; NaN where not to be believed), and why not, by axis.

        Encoders that follow their count see every sample, also those that are not used.
        """
        positions: list[float] = []
        faults: dict[str, str] = {}
        latest, problem = self._watch.taken(batch, now) if self._dated else (math.inf, "")
        oldest = now - self._stale_after
        times = []
        fresh = oldest <= latest
        for name, link, channel, convert, low, high in self._steps:
            sample = batch.get(link, _NOTHING).get(channel, _MISSING)
            if convert is not None:
                sample = convert(sample)
            value, time, quality, _ = sample
            times.append(time)
            if fresh and quality is _GOOD and time >= oldest and low <= value <= high:
                positions.append(value)
            else:
                positions.append(math.nan)
                faults[name] = _why(sample, now, min(time, latest), (low, high))
        self.taken_at = min(latest, *times)
        problem = problem or self._watch.fault(batch, now)
        if problem:
            for i, source in enumerate(self._sources):
                positions[i] = math.nan
                faults.setdefault(source.name, problem)
        for link, channel, axes in self._echoed:
            echo = batch[link][channel]
            for i in axes:
                if times[i] != echo.time and echo.good:
                    # read in another question than the sample number
                    positions[i] = math.nan
                    faults.setdefault(
                        self._sources[i].name, "not of the sample that is written back"
                    )
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
    plausible
        Which values are not to be believed.
    typed
        Signals that a person types in → s for which that counts at most.
    """

    def __init__(
        self,
        sources: Sequence[ChannelSource],
        stale_after: float,
        plausible: Plausible | None = None,
        typed: Mapping[str, float] | None = None,
    ) -> None:
        self.typed = dict(typed or {})
        self._until: dict[str, float] = {}
        self._sources = tuple(sources)
        self._stale_after = stale_after
        self._plausible = plausible or Plausible({})
        self.readings: Mapping[str, SignalReading] = {s.name: SignalReading() for s in sources}
        """By signal; replaced as a whole at every call."""
        self.readings = {
            **self.readings, **{n: SignalReading(fault=_NOT_ENTERED) for n in self.typed}
        }  # fmt: skip

    def enter(self, name: str, value: float, seconds: float | None, now: float) -> float:
        """Take a value that a person has read at `now`; the s for which it counts.

        Raises
        ------
        InputError
            For a signal that is not typed in, a value that is not plausible, and too long a time.
        """
        if name not in self.typed:
            raise InputError(
                "not a signal that is typed in",
                field=name,
                expected="one of " + (", ".join(self.typed) or "none"),
            )
        longest = self.typed[name]
        if seconds is not None and seconds > longest:
            raise InputError(
                "counts for no longer than the configuration says",
                field=name,
                found=f"{seconds:g} s",
                expected=f"{longest:g} s at most",
            )
        if doubt := self._plausible.outside(name, value):
            raise InputError(doubt, field=name)
        good_for = longest if seconds is None else seconds
        self._until[name] = now + good_for
        self.readings = {**self.readings, name: SignalReading(value, "", now)}
        return good_for

    def _typed_in(self, name: str, now: float) -> SignalReading:
        held = self.readings[name]
        if name not in self._until:
            return held
        fault = self._plausible.outside(name, held.value)
        if now > self._until[name]:
            fault = f"was typed in {now - held.time:.0f} s ago and counts no longer"
        return SignalReading(held.value, fault, held.time)

    def judge(self, plausible: Plausible) -> None:
        """Change what is believed, from the next reading on."""
        self._plausible = plausible

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
                doubt = self._plausible.doubt(source.name, sample.value, sample.time)
                if doubt:
                    held = SignalReading(held.value, doubt, held.time)
                else:
                    held = SignalReading(sample.value, "", sample.time)
            elif sample.quality is not Quality.UNAVAILABLE or now - held.time > self._stale_after:
                held = SignalReading(held.value, _why(sample, now, sample.time), held.time)
            fresh[source.name] = held
        for name in self.typed:
            fresh[name] = self._typed_in(name, now)
        for name, doubt in self._plausible.compared(fresh).items():
            fresh[name] = SignalReading(fresh[name].value, doubt, fresh[name].time)
        self.readings = fresh
        return fresh


_NOT_ENTERED = "nobody has typed it in yet"


class ToolConverter:
    """Three channels → the tool's offset, as the controller knows it.

    Parameters
    ----------
    channels
        Of x, y, z in mm; empty where the offset is fixed.
    stale_after
        s after which the last offset counts as stale: the tool may have been changed.
    longest
        Least and greatest x, y and z that a tool can have, mm.

    Attributes
    ----------
    fault
        Why the tool's offset is not known; empty when it is, or is fixed.
    """

    def __init__(
        self,
        channels: Sequence[Channel],
        stale_after: float,
        longest: Sequence[tuple[float, float]] = ((-math.inf, math.inf),) * 3,
    ) -> None:
        self._channels = tuple(channels)
        self._stale_after = stale_after
        self._longest = tuple(longest)
        self._taken_at = -math.inf
        self.fault = "not read yet" if self._channels else ""

    def __call__(self, batch: Batch, now: float) -> tuple[float, float, float] | None:
        """The offset (mm) where it was read now; `now` is monotonic, s."""
        if not self._channels:
            return None
        samples = [batch.get(link, _NOTHING).get(name, _MISSING) for link, name in self._channels]
        for i, sample in enumerate(samples):
            if sample.quality is not _GOOD or not isfinite(sample.value):
                unknown = sample.quality is not Quality.UNAVAILABLE
                if unknown or now - self._taken_at > self._stale_after:
                    self.fault = _why(sample, now, sample.time)
                return None
            low, high = self._longest[i]
            if not low <= sample.value <= high:
                self.fault = f"{'xyz'[i]} = {sample.value:g} mm is not {low:g} to {high:g} mm"
                return None
        taken_at = min(s.time for s in samples)
        if now - taken_at > self._stale_after:
            self.fault = f"stale: {in_digits(now - taken_at, 2)} s old"
            return None
        self._taken_at, self.fault = taken_at, ""
        x, y, z = (s.value for s in samples)
        return x, y, z


def _why(
    sample: Sample,
    now: float,
    time: float,
    limits: tuple[float, float] = (-math.inf, math.inf),
) -> str:
    if sample.quality is not _GOOD:
        return sample.reason or sample.quality.value
    if not isfinite(sample.value):
        return f"not a number: {sample.value}"
    if not limits[0] <= sample.value <= limits[1]:
        return f"{sample.value:g} is not {limits[0]:g} to {limits[1]:g}"
    return f"stale: {in_digits(now - time, 2)} s old"
