"""A link to nothing: channels in memory, for the pipeline's own logic; protocols run elsewhere."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Mapping, Sequence

from abbe.drivers.link import (
    ChannelInfo,
    Link,
    LinkConfig,
    LinkState,
    Quality,
    Sample,
    TooLateError,
)


class MemoryLink(Link):
    """Hands out `values` (None: unavailable) and keeps what is `written`.

    `broken`: raised by `read`; `write_error`: raised by `write`; `hangs`: `read` never returns;
    `delay`: s that it takes.
    """

    Config = LinkConfig

    def __init__(self, name: str, values: Mapping[str, float | None]) -> None:
        super().__init__(name, LinkConfig())
        self.values: dict[str, float | None] = dict(values)
        self.written: list[dict[str, float]] = []
        self.broken: Exception | None = None
        self.write_error: Exception | None = None
        self.hangs = False
        self.delay = 0.0
        self.status.become(LinkState.UP)

    @property
    def channels(self) -> Mapping[str, str]:
        return dict.fromkeys(self.values, "memory")

    def info(self, channel: str) -> ChannelInfo:
        return ChannelInfo(writable=True)

    async def open(self) -> None:
        pass

    async def read(self, channels: Sequence[str]) -> dict[str, Sample]:
        if self.hangs:
            await asyncio.Event().wait()
        await asyncio.sleep(self.delay)
        if self.broken is not None:
            raise self.broken
        now = time.monotonic()
        return {name: self._sample(self.values[name], now) for name in channels}

    @staticmethod
    def _sample(value: float | None, now: float) -> Sample:
        if value is None:
            return Sample(math.nan, now, Quality.UNAVAILABLE, "no answer")
        return Sample(value, now)

    async def write(self, values: Mapping[str, float], *, until: float = math.inf) -> None:
        if time.monotonic() > until:
            raise TooLateError("too old before it could be sent").leaving(untouched=values)
        if self.write_error is not None:
            raise self.write_error
        self.written.append(dict(values))

    async def close(self) -> None:
        self.status.become(LinkState.CLOSED)
