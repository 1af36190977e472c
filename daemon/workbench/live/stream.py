"""The live events of a run for one browser, as server-sent events."""

from __future__ import annotations

from collections.abc import AsyncGenerator

from abbe.daemon.http.event_stream import EventStream
from abbe.daemon.workbench.live.follower import LiveFollower

_QUIET = 5.0
"""s without an event after which a line of comment says that the workbench lives."""


class LiveEvents(EventStream):
    """``event: run`` is a status, ``cycle`` newer positions, ``lost`` since when nobody answers.

    Parameters
    ----------
    follower
        Where they come from.
    """

    def __init__(self, follower: LiveFollower) -> None:
        super().__init__()
        self._follower = follower

    async def events(self) -> AsyncGenerator[bytes, None]:
        """What is new, until the browser goes."""
        with self._follower.stream() as events:
            while True:
                taken = await events.take(_QUIET)
                if self._follower.ended:
                    return
                yield (
                    b"".join(
                        b"event: %s\ndata: %s\n\n" % (kind.encode(), data)
                        for kind, data in taken.items()
                    )
                    or b": nothing new\n\n"
                )
