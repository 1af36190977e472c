"""HTTP connections that are bounded: who asks nothing, or reads nothing, does not stay."""

from __future__ import annotations

import asyncio
import logging
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

MOST = 128
"""Connections of one listener at a time."""
HEAD_WITHIN = 10.0
"""s for a request's head to arrive, and for the first one to begin."""
READ_WITHIN = 30.0
"""s in which somebody has to read something of what waits for him."""
HEAD = 16_384
"""Bytes that a request's head may have."""


class BoundedProtocol(H11Protocol):
    """uvicorn's own protocol with the time limits that it lacks."""

    _head: asyncio.TimerHandle | None = None
    _stalled: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection; of too many the one goes that has owed its request for longest."""
        super().connection_made(transport)
        if len(self.connections) > MOST:
            # who asks something says it at once: only who drips, or is silent, still owes
            owing = [c for c in self.connections if isinstance(c, BoundedProtocol) and c._head]
            longest = min(owing, key=lambda c: c._owed_by(), default=self)
            longest.transport.abort()
            if longest is self:
                return
            # it is counted until the loop has ended it; the next one ends another
            self.connections.discard(longest)
        self._wait_for_a_head()

    def data_received(self, data: bytes) -> None:
        """Take what has come; a head has to be whole in time, however slowly it drips."""
        super().data_received(data)
        answering = self.cycle is not None and not self.cycle.response_complete
        if answering or self.transport.is_closing():
            self._end(self._head)
            self._head = None
        else:
            self._wait_for_a_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        for timer in (self._head, self._stalled):
            self._end(timer)
        self._head = self._stalled = None
        super().connection_lost(exc)

    def pause_writing(self) -> None:
        """More waits than is kept: he has to read some of it in time."""
        super().pause_writing()
        if self._stalled is None:
            self._stalled = self.loop.call_later(READ_WITHIN, self.transport.abort)

    def resume_writing(self) -> None:
        """He reads."""
        super().resume_writing()
        self._end(self._stalled)
        self._stalled = None

    def _wait_for_a_head(self) -> None:
        if self._head is None:
            self._head = self.loop.call_later(HEAD_WITHIN, self.transport.abort)

    def _owed_by(self) -> float:
        """When its head has to be there."""
        return self._head.when() if self._head is not None else float("inf")

    @staticmethod
    def _end(timer: asyncio.TimerHandle | None) -> None:
        if timer is not None:
            timer.cancel()


def bounded_config(app: Any) -> uvicorn.Config:
    """The settings of an HTTP server: bounded connections, no log and no signals of its own.

    Parameters
    ----------
    app
        The ASGI application.
    """
    return uvicorn.Config(
        app,
        http=BoundedProtocol,
        ws="none",
        lifespan="off",
        loop="asyncio",
        log_config=None,
        log_level=logging.ERROR,
        access_log=False,
        proxy_headers=False,
        server_header=False,
        backlog=64,
        timeout_graceful_shutdown=1,
        h11_max_incomplete_event_size=HEAD,
    )
