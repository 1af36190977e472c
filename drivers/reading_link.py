"""Links that only read: a write is refused in one way, in the link's own words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from abbe.drivers.link import Link, LinkError


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
