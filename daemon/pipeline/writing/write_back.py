"""Write back: corrected positions, status word and heartbeat → the controller."""

from __future__ import annotations

import asyncio
import logging
import math
import secrets
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from abbe.daemon.pipeline.reading.poll import Batch, Channel
from abbe.drivers.link import Link, LinkError, LinkState
from abbe.drivers.transducers import SensorFaultError, Transducer

logger = logging.getLogger("abbe.pipeline")

OPEN = (LinkState.UP, LinkState.DEGRADED)
"""States of a link in which something can be written."""
_HEARTBEATS = 1 << 16
"""Where the heartbeat begins again at 0, unless its channel holds less."""


@dataclass(frozen=True, slots=True)
class AxisTarget:
    """The channel for one axis's corrected position.

    Attributes
    ----------
    axis
        Its name.
    channel
        Where it is written.
    transducer
        Read backwards, mm → counts (rotary: rad → degrees or counts); None where the channel takes
        mm (rotary: rad).
    """

    axis: str
    channel: Channel
    transducer: Transducer | None = None


class Held(NamedTuple):
    """The value that a channel of the controller was last known to hold.

    Attributes
    ----------
    value
        In the channel's unit.
    time
        When it was written, monotonic, s.
    sure
        Whether the controller confirmed it; else it was sent, and nobody knows.
    """

    value: float
    time: float
    sure: bool


class WriteOutcome(NamedTuple):
    """The outcome of writing one cycle's answer.

    Attributes
    ----------
    written
        Whether the controller took all corrected positions.
    problem
        What went wrong; empty when nothing did.
    untouched, unknown
        Masks of the targets (bit 0 the first) that certainly hold what they held before, and of
        those of which nobody knows.
    """

    written: bool
    problem: str = ""
    untouched: int = 0
    unknown: int = 0


_DONE = WriteOutcome(True)


class WriteBack:
    """Writes one cycle's answer, in one batch for each link.

    Parameters
    ----------
    links
        All links.
    targets
        Axes that are written.
    echo
        Channels that are written as they were read: (source, target).
    status, heartbeat
        Where the status word and the heartbeat go, None: nowhere.
    beats
        Where the heartbeat begins again at 0.

    Attributes
    ----------
    shut
        Links over which nothing is written for now, because somebody else may.
    others
        Those of them over which somebody else certainly does.
    """

    def __init__(
        self,
        links: Mapping[str, Link],
        targets: Sequence[AxisTarget],
        echo: Sequence[tuple[Channel, Channel]] = (),
        status: Channel | None = None,
        heartbeat: Channel | None = None,
        beats: int = _HEARTBEATS,
    ) -> None:
        self._links = links
        self._steps = tuple(
            (t.axis, *t.channel, None if t.transducer is None else t.transducer.inverse)
            for t in targets
        )
        self._channels = tuple(t.channel for t in targets)
        self._echo = tuple(echo)
        self._status = status
        self._heartbeat = heartbeat
        written = [status, *self._channels, *(c for _, c in echo), heartbeat]
        self._order = tuple(dict.fromkeys(c[0] for c in written if c is not None))
        self._together = _together(links, self._channels)
        # two computers that begin alike must not beat alike
        self._beats, self._wrap = secrets.randbelow(beats), beats
        self.shut: set[str] = set()
        self.others: set[str] = set()
        self._broken: set[str] = set()
        self._took: dict[str, float] = {}
        self._last: dict[str, tuple[Mapping[str, float], float]] = {}
        self._earlier: dict[Channel, Held] = {}

    @property
    def held(self) -> dict[Channel, Held]:
        """What the controller's channels were last known to hold."""
        found = dict(self._earlier)
        for link, (values, at) in self._last.items():
            found.update({(link, name): Held(value, at, True) for name, value in values.items()})
        return found

    def took(self, link: str) -> float:
        """When all that was sent over a link was last taken, monotonic, s; -inf: never."""
        return self._took.get(link, -math.inf)

    async def __call__(
        self, corrected: Sequence[float], batch: Batch, status: int, until: float = math.inf
    ) -> WriteOutcome:
        """Write what is known.

        Parameters
        ----------
        corrected
            For each target, mm (rotary: rad); NaN where the indicated position is not to be
            believed: then the controller's register is left alone, and so are those that go out in
            one message with it.
        batch
            What was read in this cycle, for the echo.
        status
            The status word.
        until
            Monotonic time in s after which nothing of it may leave any more.
        """
        values, missing, problem = self._values(corrected, batch, status)
        if len(values) == 1:
            ((link, channels),) = values.items()
            failures = [await self._write(link, channels, until)]
        else:
            failures = await asyncio.gather(*(self._write(*item, until) for item in values.items()))
        if not (missing or any(failures)):
            return _DONE
        return self._outcome(missing, problem, failures)

    def _outcome(
        self, missing: int, problem: str, failures: Iterable[LinkError | None]
    ) -> WriteOutcome:
        untouched, unknown = missing, 0
        said = []
        for link, failure in zip(self._order, failures, strict=True):
            if failure is None:
                continue
            if why := str(failure):
                said.append(why)
            for i, (target_link, name) in enumerate(self._channels):
                if target_link != link or missing >> i & 1 or name in failure.written:
                    continue
                if name in failure.untouched:
                    untouched |= 1 << i
                else:
                    unknown |= 1 << i
        return WriteOutcome(False, "; ".join(said) or problem, untouched, unknown)

    def _values(
        self, corrected: Sequence[float], batch: Batch, status: int
    ) -> tuple[dict[str, dict[str, float]], int, str]:
        """What is written, by link and channel; the mask of targets left out; and why they are."""
        values: dict[str, dict[str, float]] = {name: {} for name in self._order}
        problem, missing = "", 0
        if self._status is not None:
            values[self._status[0]][self._status[1]] = status
        for place, (axis, link, name, encode) in enumerate(self._steps[: len(corrected)]):
            position = corrected[place]
            if position != position:
                missing |= 1 << place
            elif encode is None:
                values[link][name] = position
            else:
                try:
                    values[link][name] = encode(position)
                except SensorFaultError as error:
                    problem, missing = f"{axis} cannot be written: {error}", missing | 1 << place
        if missing and self._together:
            missing = self._leave_out(missing, values)
        if not missing and batch:
            for (source_link, source), (link, name) in self._echo:
                sample = batch[source_link][source]
                if sample.good:
                    values[link][name] = sample.value
        if self._heartbeat is not None:
            self._beats = (self._beats + 1) % self._wrap
            values[self._heartbeat[0]][self._heartbeat[1]] = self._beats
        return values, missing, problem

    def _leave_out(self, missing: int, values: Mapping[str, dict[str, float]]) -> int:
        """Leave out all that goes out in one message with a target that is left out."""
        for mask in self._together:
            if mask & missing:
                missing |= mask
        for i, (link, name) in enumerate(self._channels):
            if missing >> i & 1:
                values[link].pop(name, None)
        return missing

    async def _write(
        self, name: str, channels: Mapping[str, float], until: float
    ) -> LinkError | None:
        if not channels:
            return None
        link = self._links[name]
        if link.status.state not in OPEN:
            down = LinkError(f"link {name} is {link.status.state.value}")
            return down.leaving(untouched=channels)
        if name in self.shut:
            return LinkError("").leaving(untouched=channels)  # why, says who shut it
        try:
            await link.write(channels, until=until)
        except LinkError as error:
            self._note(name, channels, error)
            return error
        except Exception as error:
            # a link raises LinkError only; a driver that does not must not end the rest
            if name not in self._broken:
                self._broken.add(name)
                logger.exception("link %s: its driver failed while writing", name)
            failed = LinkError(f"link {name}: its driver failed: {error}")
            self._note(name, channels, failed)
            return failed
        self._broken.discard(name)
        before = self._last.get(name)
        if before is not None and before[0].keys() != channels.keys():
            self._put_aside(name)
        self._took[name] = now = time.monotonic()
        self._last[name] = channels, now
        return None

    def _put_aside(self, link: str) -> None:
        values, at = self._last.pop(link, ({}, 0.0))
        self._earlier.update({(link, name): Held(v, at, True) for name, v in values.items()})

    def _note(self, link: str, channels: Mapping[str, float], error: LinkError) -> None:
        """Keep in mind what is held after a write that failed."""
        self._put_aside(link)
        now = time.monotonic()
        for channel, value in channels.items():
            if channel in error.written:
                self._earlier[link, channel] = Held(value, now, True)
            elif channel not in error.untouched:
                self._earlier[link, channel] = Held(value, now, False)


def _together(links: Mapping[str, Link], targets: Sequence[Channel]) -> tuple[int, ...]:
    """Masks of the targets that go out in one message with others; those that go alone left out."""
    masks = []
    for link, name in targets:
        if link not in links:
            continue
        companions = links[link].goes_with(name)
        mask = sum(
            1 << i
            for i, (other, channel) in enumerate(targets)
            if other == link and channel in companions
        )
        if mask & (mask - 1):
            masks.append(mask)
    return tuple(dict.fromkeys(masks))
