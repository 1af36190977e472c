"""How sure the correction is, for the controller: ± of each axis, and what was never measured.

A listener that sees when ± no longer holds, and a task that writes at the uncertainty's own slow
pace, by itself: a refused ± never costs a corrected position, and the cycle waits for nothing.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass

from abbe.compcore.machine.machine import own_component
from abbe.compcore.machine.structure import is_rotary
from abbe.daemon.config import Configuration
from abbe.daemon.config.channels import split
from abbe.daemon.config.outputs import PER_MM
from abbe.daemon.guard import DIRECTIONS
from abbe.daemon.pipeline.cycle import Pipeline
from abbe.daemon.pipeline.live_uncertainty import LARGEST_OUTSIDE, LiveUncertainty, Outside
from abbe.daemon.pipeline.reading.poll import Channel, by_link
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.pipeline.writing.write_back import OPEN
from abbe.daemon.status_word import Status
from abbe.drivers.link import ChannelInfo, Link, LinkError

logger = logging.getLogger("abbe.pipeline")

NOT_KNOWN = 10.0
"""mm that are written where ± is not known, or the most that the channel holds, if that is less: a
controller that compares ± with a tolerance then finds it too wide."""
EVERY = 1.0
"""s from one write to the next."""
_WITHIN = 1.0
"""s that a write may wait for its turn."""
_ENDS_WITHIN = 2.0
"""s for which it is tried, at the end, to say that nothing is known."""
_AGAIN = 0.05
_HANGS = 2.0
"""s, beside some periods, after which the last cycle says nothing of now."""
_PERIODS = 4.0
_ACTIVE = tuple(int(bit) for bit in (Status.X_ACTIVE, Status.Y_ACTIVE, Status.Z_ACTIVE))
_ENDING = int(Status.ENDING)
_BY_CHANCE = 1e-6
"""Of a step: what arithmetic may add without the next step being meant."""


@dataclass(frozen=True, slots=True)
class ReportedAxis:
    """The channel of one axis's ±.

    Attributes
    ----------
    axis
        Its name.
    direction
        0 for X, 1 for Y, 2 for Z: which correction it is ± of.
    channel
        Where it is written.
    info
        What that can hold; in mm or µm.
    """

    axis: str
    direction: int
    channel: Channel
    info: ChannelInfo

    @property
    def not_known(self) -> float:
        """What stands for 'not known', and for everything wider, in the channel's unit."""
        most = min(NOT_KNOWN * PER_MM[self.info.unit], self.info.high)
        return self._on_step(most, up=False)

    def value(self, wide: float) -> float:
        """± (mm) in the channel's unit; never less than it is."""
        if not math.isfinite(wide) or wide < 0.0:
            return self.not_known
        return min(self._on_step(wide * PER_MM[self.info.unit], up=True), self.not_known)

    def _on_step(self, value: float, *, up: bool) -> float:
        step, low = self.info.step, self.info.low
        if not step or not math.isfinite(low):
            return value
        steps = (value - low) / step
        whole = math.ceil(steps - _BY_CHANCE) if up else math.floor(steps + _BY_CHANCE)
        return low + whole * step


class ReportedUncertainty:
    """Writes ± and what was never measured, while a correction runs.

    Parameters
    ----------
    configuration
        Says where to.
    links
        All links.
    pipeline
        What runs.
    sure
        Knows how sure the correction is.
    """

    def __init__(
        self,
        configuration: Configuration,
        links: Mapping[str, Link],
        pipeline: Pipeline,
        sure: LiveUncertainty,
    ) -> None:
        output = configuration.file.output
        self._links, self._pipeline, self._sure = links, pipeline, sure
        self._axes = [
            ReportedAxis(axis, DIRECTIONS.index(own_component(axis)), where, _info(links, where))
            for axis, channel in output.plus_minus.items()
            for where in (split(channel),)
        ]
        self._outside = None if output.outside is None else split(output.outside)
        self._largest = LARGEST_OUTSIDE
        if self._outside is not None:
            self._largest = min(LARGEST_OUTSIDE, int(_info(links, self._outside).high))
        written = {own_component(a) for a in output.axes if not is_rotary(a)}
        self._corrected = sum(
            bit for d, bit in zip(DIRECTIONS, _ACTIVE, strict=True) if d in written or not written
        )
        self._hangs = _HANGS + _PERIODS * configuration.file.cycle.period
        self._record: CycleRecord | None = None
        self._held = 0
        self._wake = asyncio.Event()
        self._problems: dict[str, str] = {}
        self._reported_unknown: set[str] = set()

    @property
    def wanted(self) -> bool:
        """Whether anything is to be written."""
        return bool(self._axes or self._outside)

    def __call__(self, record: CycleRecord) -> None:
        """Keep a cycle's record; a direction that is corrected no longer is written at once."""
        self._record = record
        holds = 0 if record.status & _ENDING else record.status & self._corrected
        if self._held & ~holds:
            self._wake.set()
        self._held = holds

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Tell it while the context lasts; at its end, that nothing is known."""
        if not self.wanted:
            yield
            return
        self._sure.listeners.append(self._wake.set)
        self._pipeline.listeners.append(self)
        task = asyncio.create_task(self._run())
        try:
            yield
        finally:
            self._sure.listeners.remove(self._wake.set)
            if self in self._pipeline.listeners:
                self._pipeline.listeners.remove(self)
            task.cancel()
            await asyncio.wait({task}, timeout=_WITHIN)
            await self._end()

    async def _run(self) -> None:
        while True:
            try:
                if self._record is not None:
                    now = time.monotonic()
                    await self._write(self._values(now), now + _WITHIN)
            except Exception:
                # whoever looks on must not disturb the machine
                logger.exception("how sure the correction is cannot be reported")
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._wake.wait(), EVERY)
            self._wake.clear()

    async def _end(self) -> None:
        """Say that nothing is known, until it is taken or the time is over."""
        until = time.monotonic() + _ENDS_WITHIN
        nothing = self._nothing()
        # before the first cycle nobody knows who else is there, and nothing was reported
        while self._record and (
            left := {n: v for n, v in nothing.items() if n not in self._reported_unknown}
        ):
            await self._write(left, until)
            if time.monotonic() + _AGAIN >= until or self._pipeline.shut:
                break
            await asyncio.sleep(_AGAIN)
        missed = sorted(set(nothing) - self._reported_unknown)
        if missed and self._record:
            logger.warning(
                "link %s: could not be written that ± is not known any more", ", ".join(missed)
            )

    def _values(self, now: float) -> dict[str, dict[str, float]]:
        """What is reported now (monotonic, s), by link and channel."""
        record, latest = self._record, self._sure.latest
        if record is None or latest is None or not self._held:
            return self._nothing()
        if now - self._pipeline.began - record.time > self._hangs:
            return self._nothing()
        reported = {
            one.channel: one.value(latest.wide[one.direction])
            if self._held & _ACTIVE[one.direction]
            else one.not_known
            for one in self._axes
        }
        return self._by_link(reported, self._sure.outside)

    def _nothing(self) -> dict[str, dict[str, float]]:
        return self._by_link({a.channel: a.not_known for a in self._axes}, Outside.UNKNOWN)

    def _by_link(
        self, reported: Mapping[Channel, float], outside: Outside
    ) -> dict[str, dict[str, float]]:
        values = dict(reported)
        if self._outside is not None:
            values[self._outside] = float(min(int(outside), self._largest))
        return {
            link: {name: values[link, name] for name in names}
            for link, names in by_link(values).items()
        }

    async def _write(self, values: Mapping[str, Mapping[str, float]], until: float) -> None:
        """Write to each link that is open and not somebody else's."""
        nothing = self._nothing()
        for name, channels in values.items():
            self._reported_unknown.discard(name)
            link = self._links[name]
            if self._pipeline.shut or link.status.state not in OPEN:
                continue
            try:
                await link.write(channels, until=until)
            except LinkError as error:
                self._problem(name, str(error))
                continue
            except Exception as error:  # noqa: BLE001  (a driver that raises what it must not)
                self._problem(name, f"its driver failed: {error}")
                continue
            self._problem(name, "")
            if channels == nothing[name]:
                self._reported_unknown.add(name)

    def _problem(self, link: str, why: str) -> None:
        """Have the journal know once when it is not taken, and once when it is again."""
        before = self._problems.get(link, "")
        self._problems[link] = why
        if why and not before:
            extra = {"event": "fault began"}
            logger.warning(
                "link %s: how sure the correction is was not written: %s", link, why, extra=extra
            )
        elif before and not why:
            extra = {"event": "fault over"}
            logger.info("link %s: how sure the correction is is written again", link, extra=extra)


def _info(links: Mapping[str, Link], channel: Channel) -> ChannelInfo:
    return links[channel[0]].info(channel[1])
