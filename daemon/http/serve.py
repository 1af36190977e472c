"""Listening: the Unix socket, and the network where the configuration says so."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import ssl
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import uvicorn

from abbe.compcore.errors import AbbeError
from abbe.daemon.config.tokens import TokenFile
from abbe.daemon.http.application import application
from abbe.daemon.http.bounded import bounded_config
from abbe.daemon.http.cycles.hub import Hub
from abbe.daemon.http.entrance import Entrance
from abbe.daemon.http.exchange.wire import Serving
from abbe.daemon.http.gate import Gate
from abbe.daemon.http.interface import Interface
from abbe.daemon.socket_path import bound

_AGAIN = 5.0
"""s until a place that cannot be had is tried again."""
_LOOK = 60.0
"""s between two looks at whether the certificate was renewed."""


async def serve(hub: Hub, setup: dict[str, Any]) -> None:
    """Listen until cancelled.

    Parameters
    ----------
    hub
        The connection to the run.
    setup
        What it said that is to be done.
    """
    gate = Gate(TokenFile(Path(setup["tokens"])), setup["clients"], hub.log)
    interface = Interface(hub, gate, setup["machine"], setup["pid"])
    app = application(interface, setup["version"])
    places = [_Place(Entrance(app, interface, local=True), path=Path(setup["socket"]))]
    places += [
        _Place(
            Entrance(app, interface, local=False),
            address=(host, port),
            certificate=setup["certificate"],
            key=setup["key"],
        )
        for host, port in setup["listen"]
    ]
    await asyncio.gather(*(_keep_listening(place, hub) for place in places))


class _Place:
    """One place to listen at."""

    def __init__(
        self,
        app: Entrance,
        *,
        path: Path | None = None,
        address: tuple[str, int] | None = None,
        certificate: str | None = None,
        key: str | None = None,
    ) -> None:
        self._app, self._path, self._address = app, path, address
        self._certificate, self._key = certificate, key
        self._inode = 0

    def __str__(self) -> str:
        if self._address is None:
            return str(self._path)
        host, port = self._address
        return f"{f'[{host}]' if ':' in host else host}:{port}"

    def bind(self) -> socket.socket:
        """A socket that is bound; raises `OSError` or `AbbeError`."""
        if self._path is not None:
            made = bound(self._path)
            self._path.chmod(0o660)
            self._inode = self._path.lstat().st_ino
            return made
        if self._address is None:
            raise OSError("nowhere to listen")
        family = socket.AF_INET6 if ":" in self._address[0] else socket.AF_INET
        made = socket.socket(family, socket.SOCK_STREAM)
        try:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            made.bind(self._address)
        except OSError:
            made.close()
            raise
        return made

    def leave(self) -> None:
        """Take the socket's file away, if it is still this one's."""
        if self._path is not None:
            with contextlib.suppress(OSError):
                if self._path.lstat().st_ino == self._inode:
                    self._path.unlink()

    async def serve(self, made: socket.socket) -> None:
        """Serve at a socket until cancelled; whoever has asked by then is answered."""
        config = bounded_config(self._app)
        config.load()
        watching = None
        if self._certificate is not None and self._key is not None:
            config.ssl = _tls(self._certificate, self._key)
            watching = asyncio.create_task(_renew(config.ssl, self._certificate, self._key))
        server = _Server(config)
        serving = asyncio.create_task(server.serve(sockets=[made]))
        try:
            await asyncio.shield(serving)
        except asyncio.CancelledError:
            server.should_exit = True
            await serving
            raise
        finally:
            if watching is not None:
                watching.cancel()


class _Server(uvicorn.Server):
    """A server that leaves signals alone: they are for the run."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


async def _keep_listening(place: _Place, hub: Hub) -> None:
    """Listen at one place; where it cannot be had, try again."""
    said = ""
    while True:
        try:
            made = place.bind()
        except (OSError, AbbeError) as error:
            why = getattr(error, "strerror", None) or str(error)
            if why != said:
                said = why
                hub.log(logging.WARNING, f"cannot listen at {place}: {why}; tried again")
            await asyncio.sleep(_AGAIN)
            continue
        hub.log(logging.INFO, f"listening at {place}")
        hub.say(Serving())
        try:
            await place.serve(made)
        finally:
            place.leave()


def _tls(certificate: str, key: str) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.load_cert_chain(certificate, key)
    return context


async def _renew(context: ssl.SSLContext, certificate: str, key: str) -> None:
    """Take a renewed certificate for the connections that come after it."""
    stamp = _stamp(certificate, key)
    while True:
        await asyncio.sleep(_LOOK)
        now = _stamp(certificate, key)
        if now != stamp:
            # half written, it is taken at the next look
            with contextlib.suppress(OSError):
                context.load_cert_chain(certificate, key)
                stamp = now


def _stamp(*paths: str) -> tuple[int, ...]:
    try:
        return tuple(Path(path).stat().st_mtime_ns for path in paths)
    except OSError:
        return ()
