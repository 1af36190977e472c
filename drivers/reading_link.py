"""Links that only read: a write is refused in one way, in the link's own words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from abbe.drivers.link import Link, LinkError
from abbe.drivers.scaled import ScaledNumber


class ReadingLink(Link):
    """A link that takes nothing: what is corrected goes back by another way."""

    refusal: ClassVar[str]
    """What follows "nothing written: CHANNELS": that it only reads, and what to do instead."""

    async def write(self, values: Mapping[str, float], *, until: float = math.inf) -> None:
        """Refuse: this link only reads.

        Raises
        ------
        LinkError
            Always, unless there is nothing to write.
        """
        if values:
            raise LinkError(
                f"link {self.name}: nothing written: {', '.join(values)}: {self.refusal}"
            ).leaving(untouched=values)


def described(what: str, item: int | None, every: float, channel: ScaledNumber) -> str:
    """A channel for people: what it is in the server, which number of it, how often, what unit.

    Parameters
    ----------
    what
        Its name in the server.
    item
        Which of several numbers, from 1; None where it is one.
    every
        s between two questions; 0: at every call.
    channel
        Its section.
    """
    parts = [what]
    if item is not None:
        parts.append(f"item {item}")
    if every:
        parts.append(f"every {every:g} s")
    parts += channel.scaling
    if channel.unit:
        parts.append(f"in {channel.unit}")
    return ", ".join(parts)
