"""The live events of a run for one browser, as server-sent events."""

from __future__ import annotations

import asyncio
import contextlib

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from abbe.daemon.workbench.live.follower import LiveFollower

_QUIET = 5.0
"""s without an event after which a line of comment says that the workbench lives."""


class LiveEvents(Response):
    """``event: run`` is a status, ``cycle`` newer positions, ``lost`` since when nobody answers.

    Parameters
    ----------
    follower
        Where they come from.
    """

    media_type = "text/event-stream"

    def __init__(self, follower: LiveFollower) -> None:
        super().__init__(headers={"cache-control": "no-store", "x-accel-buffering": "no"})
        del self.headers["content-length"]
        self._follower = follower

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send until the browser goes."""
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
        with self._follower.stream() as events:
            while True:
                taken = await events.take(_QUIET)
                body = b"".join(
                    b"event: %s\ndata: %s\n\n" % (kind.encode(), data)
                    for kind, data in taken.items()
                )
                content = body or b": nothing new\n\n"
                await send({"type": "http.response.body", "body": content, "more_body": True})


async def _gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
