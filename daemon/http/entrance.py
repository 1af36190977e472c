"""The entrance of the HTTP interface: what every request passes first, whatever it asks."""

from __future__ import annotations

import asyncio

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from abbe.daemon.http.cycles.hub import OVER
from abbe.daemon.http.gate import LOCAL
from abbe.daemon.http.interface import Interface

_LONGEST_BODY = 65_536
"""Bytes."""
_BODY_WITHIN = 10.0
"""s for a request's body to arrive."""


class Entrance:
    """Bounds a request, turns away who may not ask at all, and counts.

    Parameters
    ----------
    app
        What answers.
    interface
        Counts.
    local
        Whether requests come over the Unix socket.
    """

    def __init__(self, app: ASGIApp, interface: Interface, *, local: bool) -> None:
        self._app, self._interface, self._local = app, interface, local

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            return
        scope[LOCAL] = self._local
        status, begun = 500, False

        async def counted(message: Message) -> None:
            nonlocal status, begun
            if message["type"] == "http.response.start":
                status, begun = message["status"], True
            await send(message)

        try:
            await self._admit(scope, receive, counted)
        except asyncio.CancelledError:
            # the server ends, and this has not been answered in the time that it gives
            if begun:
                raise
            await _say(counted, 503, OVER.encode())
        finally:
            route = getattr(scope.get("route"), "path", "other")
            self._interface.requests.labels(route=route, status=str(status)).inc()

    async def _admit(self, scope: Scope, receive: Receive, send: Send) -> None:
        client = scope.get("client")
        gate = self._interface.gate
        if not self._local and (client is None or not gate.welcome(client[0])):
            gate.refuse(str(client and client[0]), "not among the clients of the configuration")
            await _say(send, 403, b"not from here")
            return
        if scope["method"] in ("GET", "HEAD"):
            await self._app(scope, receive, send)
            return
        try:
            async with asyncio.timeout(_BODY_WITHIN):
                body = await _body(receive)
        except TimeoutError:
            await _say(send, 408, b"too slow")
            return
        if body is None:
            await _say(send, 413, b"too long")
            return
        await self._app(scope, _replayed(body, receive), send)


async def _body(receive: Receive) -> bytes | None:
    """All of a request's body; None when it is too long."""
    found = b""
    while True:
        message = await receive()
        if message["type"] != "http.request":
            return found
        part: bytes = message.get("body", b"")
        found += part
        if len(found) > _LONGEST_BODY:
            return None
        if not message.get("more_body", False):
            return found


def _replayed(body: bytes, receive: Receive) -> Receive:
    given = False

    async def replay() -> Message:
        nonlocal given
        if given:
            return await receive()
        given = True
        return {"type": "http.request", "body": body, "more_body": False}

    return replay


async def _say(send: Send, status: int, words: bytes) -> None:
    headers = [(b"content-type", b"text/plain"), (b"connection", b"close")]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": words + b"\n"})
