"""The stream of cycles as server-sent events; who does not read loses cycles, and nobody's time."""

from __future__ import annotations

import asyncio
import contextlib
import json
from typing import Any

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from abbe.daemon.http.cycles.hub import Hub, Subscription

_QUIET = 10.0
"""s without a cycle after which a line of comment says that the stream lives."""


class CycleStream(Response):
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

    media_type = "text/event-stream"

    def __init__(self, hub: Hub, every: float) -> None:
        super().__init__(headers={"cache-control": "no-store", "x-accel-buffering": "no"})
        del self.headers["content-length"]
        self._hub, self._every = hub, every

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        await send({"type": "http.response.start", "status": 200, "headers": self.raw_headers})
        sending = asyncio.create_task(self._send_all(send))
        gone = asyncio.create_task(_gone(receive))
        try:
            await asyncio.wait({sending, gone}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (sending, gone):
                task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await asyncio.gather(sending, gone, return_exceptions=True)

    async def _send_all(self, send: Send) -> None:
        with self._hub.stream(self._every) as subscription:
            while not self._hub.ended:
                await send(_body(await _next(subscription)))
        await send({"type": "http.response.body", "body": b"", "more_body": False})


async def _next(subscription: Subscription) -> bytes:
    taken, lost = await subscription.take(_QUIET)
    parts = []
    if lost:
        parts.append(b"event: dropped\ndata: " + json.dumps({"dropped": lost}).encode() + b"\n\n")
    parts += [b"event: cycle\nid: %d\ndata: %s\n\n" % (number, event) for number, event in taken]
    return b"".join(parts) or b": nothing new\n\n"


def _body(content: bytes) -> dict[str, Any]:
    return {"type": "http.response.body", "body": content, "more_body": True}


async def _gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
