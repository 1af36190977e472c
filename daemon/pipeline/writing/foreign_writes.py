"""Foreign writes: somebody else writes what Abbe writes, found by reading it back now and then.

Another computer is not seen by a lock (`abbe.daemon.ownership.lock`), but it leaves its traces in
the controller: a heartbeat, an echo, a status word, positions that are not the ones that Abbe wrote
last. They are looked for before a cycle's positions are read, when everything that another one
writes at the same pace has been written since.

Whose heartbeat it is decides: another Abbe's, and this one keeps off at once, so that of two that
notice each other one is left; a program's that writes positions only, and the correction is ramped
to zero while the status word says why.

Who comes to a controller, or comes back after a while, listens before it writes: where the status
word says that somebody runs, and it is not what was written from here, nothing is written until
what is there has stood still. The one that is at work does not notice.
"""

from __future__ import annotations

import asyncio
import logging
import math
import random
from collections.abc import Mapping
from dataclasses import dataclass, field

from abbe.daemon.pipeline.reading.poll import Channel, by_link
from abbe.daemon.pipeline.writing.write_back import OPEN, Held, WriteBack
from abbe.daemon.status_word import Status, describe
from abbe.drivers.link import Link, Quality, Sample

logger = logging.getLogger("abbe.pipeline")

_REMEMBERED = 3.0
"""Looks for which a foreign write counts: who wrote once will write again."""
_GIVES_UP = 3
"""Refusals in a row after which a channel counts as one that cannot be read."""
_DITHER = 0.25
"""Part of the period by which a look comes at another moment each time: what somebody always writes
just before this one writes would never be seen."""
_LISTENS = 2.0
"""Looks, or cycles if these take longer, for which is listened to a controller that looks as if
somebody were at work there."""
_HEARD = 1.5
"""Of the time for which is listened, that a listening takes at most, with the looks around it."""


@dataclass(slots=True)
class Listening:
    """Listening on one link before something is written over it.

    Attributes
    ----------
    since
        When it began, monotonic, s.
    last_values
        Channel → what it held at the last look.
    changed
        When something changed that was not written from here, monotonic, s.
    quiet_for
        s for which nothing must have changed since.
    said
        Whether it was logged.
    """

    since: float
    last_values: dict[str, float] = field(default_factory=dict)
    changed: float = -math.inf
    quiet_for: float = 0.0
    said: bool = False


class Foreign:
    """The check for foreign writes: reads back what was written and compares.

    Parameters
    ----------
    links
        All links.
    channels
        What is written and can be read back.
    write_back
        Knows what was written and when; sets over which links nothing may be written yet.
    status, heartbeat
        Those of `channels` that these go to, None: none.
    counters
        Those of `channels` that a controller may clear by itself: status word, heartbeat, echo. A
        0 there is nobody's.
    every
        s between two looks.
    period
        Of the cycle, s.
    """

    def __init__(
        self,
        links: Mapping[str, Link],
        channels: tuple[Channel, ...],
        write_back: WriteBack,
        status: Channel | None,
        heartbeat: Channel | None,
        counters: frozenset[Channel],
        every: float,
        period: float,
    ) -> None:
        self._links = links
        self._write_back = write_back
        self._status = status
        self._counters = counters
        self._heartbeat = heartbeat
        self._every = every
        self._listens = _LISTENS * max(every, period)
        self._dither = _DITHER * period
        self._due = self._until = self._none_late_until = -math.inf
        self._refused: dict[Channel, int] = dict.fromkeys(channels, 0)
        self._names = by_link(channels)
        self._listening: dict[str, Listening] = {}
        self._opened: dict[str, float] = {}
        self._tolerance = {
            (link, name): 0.51 * links[link].info(name).step for link, name in channels
        }
        self.fault = ""
        """What was found, for people; empty when nothing was, or long ago."""

    def due(self, now: float) -> bool:
        """Whether it is time for another look, at `now` (monotonic, s)."""
        self.shut_late(now)
        return bool(self._listening) or (now >= self._due and bool(self._refused))

    @property
    def undecided(self) -> bool:
        """Whether a link can be asked, and whether somebody else is at work there is not known."""
        return any(
            (link in self._listening or link not in self._opened)
            and link not in self._write_back.others
            and self._links[link].status.state in OPEN
            for link in self._names
        )

    @property
    def longest_doubt(self) -> float:
        """Time after which a link that answers is decided, s."""
        return _HEARD * self._listens

    def shut_late(self, now: float) -> None:
        """Shut the links over which nothing was written for so long that another one may do."""
        if now <= self._none_late_until:
            return
        earliest = math.inf
        for link in self._names:
            last = max(self._write_back.took(link), self._opened.get(link, -math.inf))
            earliest = min(earliest, last)
            if now - last > self._listens and link not in self._listening:
                self._listening[link] = Listening(math.inf)
                self._write_back.shut.add(link)
        # what is written from now on can only move this moment further away
        self._none_late_until = earliest + self._listens

    async def look(self, now: float) -> None:
        """Read back, and compare with what was written from here as far as that is known."""
        for link in tuple(self._listening):
            await self._listen(link, now)
        if now < self._due or not self._refused:
            return
        self._due = now + self._every
        if not self._listening:
            await asyncio.sleep(random.random() * self._dither)
        held = self._write_back.held
        wanted: dict[str, list[str]] = {}
        for link, name in self._refused:
            known = held.get((link, name))
            if known is not None and known.sure and link not in self._listening:
                wanted.setdefault(link, []).append(name)
        for link, names in wanted.items():
            samples = await self._links[link].read(tuple(names))
            for name in names:
                self._judge((link, name), samples[name], held[link, name], now)
        if now > self._until and not self._listening:
            self.fault = ""

    def _judge(self, channel: Channel, sample: Sample, wrote: Held, now: float) -> None:
        if not self._taken(channel, sample) or self._ours(channel, sample.value, wrote):
            return
        link, name = channel
        if channel == self._heartbeat:
            self._listening[link] = Listening(now, {name: sample.value})
            self._keep_off(link, name, now)
        elif link not in self._listening:
            self._until = now + _REMEMBERED * self._every
            self.fault = (
                f"somebody else writes {'.'.join(channel)}: Abbe wrote {wrote.value:.10g}, and it "
                f"holds {sample.value:.10g}"
            )

    def _taken(self, channel: Channel, sample: Sample) -> bool:
        """Whether a sample says something; a channel that is refused again and again is given up.

        Nothing is heard of it then, and that is said once.
        """
        if sample.good:
            self._refused[channel] = 0
        elif sample.quality is Quality.BAD:
            self._refused[channel] += 1
            if self._refused[channel] >= _GIVES_UP:
                del self._refused[channel]
                logger.info(
                    "%s.%s cannot be read back (%s): foreign writes to it go unnoticed",
                    *channel,
                    sample.reason,
                )
        return sample.good

    def _ours(self, channel: Channel, value: float, wrote: Held) -> bool:
        if not value and channel in self._counters:
            return True
        slack = self._tolerance[channel] + 1e-6 * abs(wrote.value)
        return abs(value - wrote.value) <= slack

    async def _listen(self, link: str, now: float) -> None:
        """One look at a link over which nothing is written yet."""
        one = self._listening[link]
        if self._links[link].status.state not in OPEN:
            one.since = math.inf
            return
        one.since = min(one.since, now)
        names = tuple(name for name in self._names[link] if (link, name) in self._refused)
        samples = await self._links[link].read(names) if names else {}
        there = {n: s.value for n, s in samples.items() if self._taken((link, n), s)}
        if not names or self._is_free(link, there):
            self._open(link, now)
            return
        # a controller may show its own positions where nobody writes; a heartbeat it leaves alone
        telling = [n for n in there if (link, n) == self._heartbeat] or list(there)
        changed = [n for n in telling if there[n] != one.last_values.get(n, there[n])]
        one.last_values |= there
        if changed:
            self._keep_off(link, changed[0], now)
        found = link in self._write_back.others
        if now - max(one.since, one.changed) >= (one.quiet_for if found else self._listens):
            self._open(link, now)
        elif not one.said and self._status is not None and self._status[1] in there:
            one.said = True
            word = int(there[self._status[1]])
            logger.info(
                "link %s: the status word says that somebody is at work (%#06x: %s): listening "
                "for %g s before anything is written",
                link,
                word,
                describe(word),
                self._listens,
            )

    def _keep_off(self, link: str, name: str, now: float) -> None:
        """Write nothing over a link, because somebody else was found to write there."""
        one = self._listening[link]
        one.changed = now
        if link in self._write_back.others:
            return
        # two that keep off at the same moment must not come back at the same moment
        one.quiet_for = _REMEMBERED * self._every * (1.0 + random.random())
        self._write_back.shut.add(link)
        self._write_back.others.add(link)
        self.fault = (
            f"another computer or program is at work: it writes {link}.{name} "
            f"({one.last_values[name]:.10g}); "
            f"nothing is written from here until it has been silent for {one.quiet_for:.1f} s"
        )

    def _is_free(self, link: str, there: Mapping[str, float]) -> bool:
        """Whether a controller shows at once that nobody else is at work there."""
        if self._status is not None and self._status[0] == link:
            word = there.get(self._status[1])
            if word is not None and not int(word) & Status.RUNNING:
                return True
        held = self._write_back.held
        if self._heartbeat is not None and self._heartbeat[0] == link:
            beat, wrote = there.get(self._heartbeat[1]), held.get(self._heartbeat)
            if beat is not None:
                # the last one may have been lost on the way
                return wrote is not None and 0.0 <= wrote.value - beat <= 1.0
        return bool(there) and all(
            (link, name) in held and self._ours((link, name), value, held[link, name])
            for name, value in there.items()
        )

    def _open(self, link: str, now: float) -> None:
        del self._listening[link]
        self._opened[link] = now
        self._write_back.shut.discard(link)
        self._write_back.others.discard(link)
        if not self._listening:
            self.fault = ""
