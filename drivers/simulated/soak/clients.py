"""Clients that ask a running Abbe without end; some never read, one talks rubbish.

They ask at the control socket; as many more ask over HTTP.
"""

from __future__ import annotations

import contextlib
import os
import socket
from functools import partial
from pathlib import Path

from abbe.drivers.simulated.soak.client_process import HttpClients
from abbe.drivers.simulated.soak.http_clients import READERS, SILENT, ClientCounts
from abbe.drivers.simulated.torment.loop import Loop

_AGAIN = 0.5
"""s between two questions of one client."""
_QUESTION = b'{"do": "state"}\n'


class Clients:
    """Ask at the control socket of a run and over HTTP, from `start` to `close`.

    Parameters
    ----------
    loop
        Of the soak.
    folder
        Where the sockets lie.

    Attributes
    ----------
    answers
        How many whole answers have come at the control socket.
    http
        What those met that ask over HTTP; known after `close`.
    """

    def __init__(self, loop: Loop, folder: Path) -> None:
        self._loop = loop
        self._path = folder / "control.sock"
        self._http_path = folder / "http.sock"
        self._http: HttpClients | None = None
        self._open: dict[socket.socket, bytes] = {}
        self._closed = False
        self.answers = 0
        self.http = ClientCounts()

    def start(self, port: int, token: str) -> None:
        """Begin to ask; HTTP also at a port of this computer, with a token."""
        self._http = HttpClients(self._http_path, 0.0, port, token)
        self._http.go()
        for number in range(READERS + SILENT + 1):
            self._loop.after(number * _AGAIN / READERS, partial(self._ask, number))

    def close(self) -> None:
        """Ask no more."""
        self._closed = True
        for client in [*self._open]:
            self._drop(client)
        if self._http is not None:
            with contextlib.suppress(OSError, ValueError):
                self.http = self._http.rest()
            self._http.close()
            self._http = None

    def _ask(self, number: int) -> None:
        """One question of one client, and the next after a while."""
        if self._closed:
            return
        client = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
        try:
            client.connect(str(self._path))
            if number < READERS + SILENT:
                client.send(_QUESTION)
            else:
                client.send(os.urandom(3000))
        except OSError:
            client.close()
        else:
            self._open[client] = b""
            if number < READERS:
                self._loop.watch(client.fileno(), lambda _: self._came(client))
            else:
                self._loop.after(20.0 * _AGAIN, lambda: self._drop(client))
        slow = 1 if number < READERS else 20
        self._loop.after(slow * _AGAIN, lambda: self._ask(number))

    def _came(self, client: socket.socket) -> None:
        data = b""
        with contextlib.suppress(OSError):
            data = client.recv(65536)
        self._open[client] += data
        if self._open[client].endswith(b"\n"):
            self.answers += 1
            data = b""
        if not data:
            self._drop(client)

    def _drop(self, client: socket.socket) -> None:
        if self._open.pop(client, None) is None:
            return
        self._loop.forget(client.fileno())
        client.close()
