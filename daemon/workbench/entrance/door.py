"""The door of the workbench: who may ask. One person's browser on this computer, nobody else.

Any page of the internet that this browser shows could try to ask a server on 127.0.0.1. So a
request counts only if it names this server (else a foreign name was pointed at 127.0.0.1: DNS
rebinding), has the cookie of this session (set once, for the address that was printed), and, where
it changes something, was sent by a page of this very server.
"""

from __future__ import annotations

import asyncio
import secrets
import time
from collections.abc import Callable, Mapping
from urllib.parse import parse_qs

from starlette.exceptions import HTTPException
from starlette.requests import cookie_parser
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from abbe.daemon.workbench.entrance.address import ENTRANCE, address_of, new_key
from abbe.daemon.workbench.entrance.asked import BROWSER

LONGEST = 65_536
"""Bytes of a request's body that are read."""
BODY_WITHIN = 20.0
"""s for a request's body to be there, once somebody began to send it."""
STREAMED = {"/api/campaigns": "text/csv"}
"""Path → what it takes: its route bounds what is sent."""
SESSION = 12.0
"""h without anything that a person did after which a session is over."""
_MOST = 64
"""Sessions at a time; the oldest goes."""

NO_SESSION = {"abbe-session": "none"}
"""Of an answer to a browser that has not entered, or whose session is over."""
_OVER = (
    "This browser has not entered, or has done nothing for too long. Open the address that the "
    "terminal shows, in which 'abbe open' runs. Each is good for one browser."
)
HEADERS = {
    # Plotly lays its pictures out by styles of its own; no script but the files of this server runs
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self' "
    "'unsafe-inline'; img-src 'self' data: blob:; connect-src 'self'; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
"""Of every answer that says nothing else."""


class WorkbenchDoor:
    """ASGI application that lets one session into another application.

    Parameters
    ----------
    app
        What is behind it.
    port
        Where the server listens on 127.0.0.1.
    invite
        Called with a new address, good for one browser: at first, and whenever one was used.
    key
        Of the first address, where it was told already; then only those after it are.
    session
        h after which a session is over in which nobody does anything; what a page asks by itself
        does not count.
    """

    def __init__(
        self,
        app: ASGIApp,
        port: int,
        invite: Callable[[str], None],
        *,
        key: str = "",
        session: float = SESSION,
    ) -> None:
        self._app = app
        self._hosts = frozenset({f"127.0.0.1:{port}", f"localhost:{port}"})
        # a cookie counts for all ports of a host
        self._cookie = f"abbe-{port}"
        self._lasts = 3600.0 * session
        self._sessions: dict[str, float] = {}
        self._numbers: dict[str, int] = {}
        self._entered = 0
        self._port, self._invite = port, invite
        self._key = key
        if not key:
            self._new_key()

    def _new_key(self) -> None:
        self._key = new_key()
        self._invite(address_of(self._port, self._key))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or hand it on."""
        if scope["type"] != "http":
            return

        session = self._session(scope)

        async def with_headers(message: Message) -> None:
            if message.get("more_body") and session and not self._lives(session):
                await send({"type": "http.response.body", "body": b"", "more_body": False})
                raise ConnectionError("the session is over")
            if message["type"] == "http.response.start":
                known = {name.lower() for name, _ in message["headers"]}
                message["headers"] += [
                    (name.encode(), value.encode())
                    for name, value in HEADERS.items()
                    if name.encode() not in known
                ]
            await send(message)

        refused = self._refusal(scope, session)
        if refused is not None:
            await refused(scope, receive, with_headers)
            return
        scope = {**scope, BROWSER: self._numbers.get(session, 0)}
        if scope["method"] == "POST" and scope["path"] in STREAMED:
            await self._app(scope, self._while_it_lives(session, receive), with_headers)
            return
        try:
            async with asyncio.timeout(BODY_WITHIN):
                body = await _body(receive)
        except TimeoutError:
            await _no(408, "the request did not come in time")(scope, receive, with_headers)
            return
        if body is None:
            await _no(413, f"no more than {LONGEST} bytes")(scope, receive, with_headers)
            return
        said: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

        async def again() -> Message:
            return said.pop() if said else await receive()

        await self._app(scope, again, with_headers)

    def _refusal(self, scope: Scope, session: str) -> Response | None:
        """What is said instead of an answer; None: the request may pass."""
        headers: dict[str, list[str]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.decode("latin-1"), []).append(value.decode("latin-1"))
        host = headers.get("host", [])
        own = [f"http://{h}" for h in host]
        if len(host) != 1 or host[0] not in self._hosts:
            return _no(421, "this is the workbench of Abbe on 127.0.0.1, and answers to no name")
        if scope["method"] not in ("GET", "HEAD", "POST"):
            return _no(405, "GET and POST only")
        if scope["path"] == ENTRANCE and scope["method"] == "GET":
            return self._enter(scope)
        if not self._lives(session):
            return _no(403, _OVER, NO_SESSION)
        if headers.get("origin", own) != own:
            # another port of this computer is the same site: its pages send the cookie along
            return _no(403, "only pages of this workbench ask anything")
        if scope["method"] == "POST":
            kind = headers.get("content-type", [""])[0].partition(";")[0].strip().lower()
            wanted = STREAMED.get(scope["path"], "application/json")
            if headers.get("origin") != own or kind != wanted:
                return _no(403, "only pages of this workbench change anything")
        if scope["method"] == "POST" or scope["path"] == "/":
            # a person did this: a page looks with GET by itself
            self._sessions[session] = time.monotonic() + self._lasts
        return None

    def _enter(self, scope: Scope) -> Response:
        key = parse_qs(scope["query_string"].decode("latin-1")).get("key", [""])[0]
        if not secrets.compare_digest(key.encode(), self._key.encode()):
            return _no(
                403,
                "This address was used already. The terminal shows another one for each browser.",
            )
        self._new_key()
        secret = secrets.token_urlsafe(32)
        while len(self._sessions) >= _MOST:
            del self._sessions[min(self._sessions, key=lambda s: self._sessions[s])]
        self._sessions[secret] = time.monotonic() + self._lasts
        self._entered += 1
        self._numbers = {s: n for s, n in self._numbers.items() if s in self._sessions}
        self._numbers[secret] = self._entered
        entered = RedirectResponse("/", 303)
        entered.set_cookie(self._cookie, secret, httponly=True, samesite="strict", path="/")
        return entered

    def _session(self, scope: Scope) -> str:
        """The session that a request belongs to; empty where it has none."""
        cookies = [v.decode("latin-1") for n, v in scope["headers"] if n == b"cookie"]
        # all programs on 127.0.0.1 share their cookies, and others' may be in any form
        mine = cookie_parser("; ".join(cookies)).get(self._cookie, "")
        known = [s for s in self._sessions if secrets.compare_digest(mine.encode(), s.encode())]
        return known[0] if known else ""

    def _while_it_lives(self, session: str, receive: Receive) -> Receive:
        """What is sent, as long as the session is not over: not even the last piece after it."""

        async def next_piece() -> Message:
            message = await receive()
            if not self._lives(session):
                raise HTTPException(403, _OVER, {**NO_SESSION, "connection": "close"})
            return message

        return next_piece

    def _lives(self, session: str) -> bool:
        """Whether a session is not over."""
        if self._sessions.get(session, 0.0) > time.monotonic():
            return True
        self._sessions.pop(session, None)
        return False


def _no(status: int, why: str, headers: Mapping[str, str] | None = None) -> Response:
    # what was sent along is not read, or not to its end
    return PlainTextResponse(f"{why}\n", status, {**(headers or {}), "connection": "close"})


async def _body(receive: Receive) -> bytes | None:
    """A request's body; None where it is too long."""
    parts, taken, more = [], 0, True
    while more:
        message = await receive()
        parts.append(message.get("body", b""))
        taken += len(parts[-1])
        more = message["type"] == "http.request" and message.get("more_body", False)
        if taken > LONGEST:
            return None
    return b"".join(parts)
