"""The stream of cycles as server-sent events; who does not read loses cycles, and nobody's time."""

from __future__ import annotations

import json
from collections.abc import AsyncGenerator

from abbe.daemon.http.cycles.hub import Hub, Subscription
from abbe.daemon.http.event_stream import EventStream

_QUIET = 10.0
"""s without a cycle after which a line of comment says that the stream lives."""


class CycleStream(EventStream):
    """Sends events until the client goes, or the run is over.

    ``event: cycle`` holds a `StreamedCycle`; ``event: dropped`` says how many are missing before
    the next.

    Parameters
    ----------
    hub
        Where cycles come from.
    every
        s from one to the next; 0: every one.
    """

    def __init__(self, hub: Hub, every: float) -> None:
        super().__init__()
        self._hub, self._every = hub, every

    async def events(self) -> AsyncGenerator[bytes, None]:
        """Cycles, until the run is over."""
        with self._hub.stream(self._every) as subscription:
            while not self._hub.ended:
                yield await _next(subscription)


async def _next(subscription: Subscription) -> bytes:
    taken, lost = await subscription.take(_QUIET)
    parts = []
    if lost:
        parts.append(b"event: dropped\ndata: " + json.dumps({"dropped": lost}).encode() + b"\n\n")
    parts += [b"event: cycle\nid: %d\ndata: %s\n\n" % (number, event) for number, event in taken]
    return b"".join(parts) or b": nothing new\n\n"
