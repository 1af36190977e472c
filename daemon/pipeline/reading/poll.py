"""Poll: one batch read from every link that carries positions, all at once."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Iterable, Mapping

from abbe.drivers.link import Link, Quality, Sample

logger = logging.getLogger("abbe.pipeline")

Channel = tuple[str, str]
"""Link and channel."""

Batch = dict[str, dict[str, Sample]]
"""Link → channel → sample."""


def by_link(channels: Iterable[Channel]) -> dict[str, tuple[str, ...]]:
    """Channels to be read, each once, by their link.

    >>> by_link([("cmm", "a"), ("air", "t"), ("cmm", "b"), ("cmm", "a")])
    {'cmm': ('a', 'b'), 'air': ('t',)}
    """
    names: dict[str, dict[str, None]] = {}
    for link, name in channels:
        names.setdefault(link, {})[name] = None
    return {link: tuple(channels) for link, channels in names.items()}


class Poll:
    """Reads the same channels again and again.

    Parameters
    ----------
    links
        All links.
    wanted
        Link → channels.
    """

    def __init__(self, links: Mapping[str, Link], wanted: Mapping[str, tuple[str, ...]]) -> None:
        self._reads = [(name, links[name], channels) for name, channels in wanted.items()]
        self._broken: set[str] = set()

    async def __call__(self) -> Batch:
        """One sample for every channel; what could not be read has a bad quality."""
        if len(self._reads) == 1:
            name, link, channels = self._reads[0]
            return {name: await self._read(name, link, channels)}
        answers = await asyncio.gather(*(self._read(*read) for read in self._reads))
        return {read[0]: answer for read, answer in zip(self._reads, answers, strict=True)}

    async def _read(self, name: str, link: Link, channels: tuple[str, ...]) -> dict[str, Sample]:
        try:
            samples = await link.read(channels)
        except Exception as error:
            # a link hands back qualities, not exceptions; one that does not must not end the rest
            if name not in self._broken:
                self._broken.add(name)
                logger.exception("link %s: its driver failed while reading", name)
            lost = Sample(math.nan, time.monotonic(), Quality.UNAVAILABLE, f"driver: {error}")
            return dict.fromkeys(channels, lost)
        self._broken.discard(name)
        return samples
