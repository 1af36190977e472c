"""Foreign writes: somebody else writes what Abbe writes, found by reading it back now and then."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping

from abbe.daemon.pipeline.reading.poll import Channel
from abbe.daemon.pipeline.writing.write_back import Held
from abbe.drivers.link import Link, Quality

logger = logging.getLogger("abbe.pipeline")

_REMEMBERED = 3.0
"""Looks for which a foreign write counts: who wrote once will write again."""
_GIVES_UP = 3
"""Refusals in a row after which a channel counts as one that cannot be read."""


class Foreign:
    """The check for foreign writes: reads back what was written and compares.

    Parameters
    ----------
    links
        All links.
    channels
        What is written and can be read back.
    every
        s between two looks.
    """

    def __init__(
        self, links: Mapping[str, Link], channels: tuple[Channel, ...], every: float
    ) -> None:
        self._links = links
        self._every = every
        self._due = -math.inf
        self._until = -math.inf
        self._refused: dict[Channel, int] = dict.fromkeys(channels, 0)
        self._tolerance = {
            (link, name): 0.51 * links[link].info(name).step for link, name in channels
        }
        self.fault = ""
        """What was found, for people; empty when nothing was, or long ago."""

    def due(self, now: float) -> bool:
        """Whether it is time for another look, at `now` (monotonic, s)."""
        return now >= self._due and bool(self._refused)

    async def look(self, held: Mapping[Channel, Held], now: float) -> None:
        """Read back and compare with what is `held` as far as is known."""
        self._due = now + self._every
        wanted: dict[str, list[str]] = {}
        for link, name in self._refused:
            if (known := held.get((link, name))) is not None and known.sure:
                wanted.setdefault(link, []).append(name)
        for link, names in wanted.items():
            samples = await self._links[link].read(tuple(names))
            for name in names:
                sample, channel = samples[name], (link, name)
                if sample.quality is Quality.BAD:
                    self._refuse(channel, sample.reason)
                if not sample.good:
                    continue
                self._refused[channel] = 0
                wrote = held[channel].value
                slack = self._tolerance[channel] + 1e-6 * abs(wrote)
                if abs(sample.value - wrote) > slack:
                    self._until = now + _REMEMBERED * self._every
                    self.fault = (
                        f"somebody else writes {link}.{name}: Abbe wrote {wrote:.10g}, and it "
                        f"holds {sample.value:.10g}"
                    )
        if now > self._until:
            self.fault = ""

    def _refuse(self, channel: Channel, why: str) -> None:
        self._refused[channel] += 1
        if self._refused[channel] >= _GIVES_UP:
            del self._refused[channel]
            logger.info(
                "%s.%s cannot be read back (%s): foreign writes to it go unnoticed", *channel, why
            )
