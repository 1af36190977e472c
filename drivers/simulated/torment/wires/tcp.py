"""A TCP server without a protocol: takes clients in, cuts them off, sends."""

from __future__ import annotations

import contextlib
import socket
import struct
from collections.abc import Callable

from abbe.drivers.simulated.torment.judge.evidence import WireLog
from abbe.drivers.simulated.torment.loop import Loop, Moment


class Client:
    """One connection; `held` is what came and is not a whole message yet."""

    def __init__(self, connection: socket.socket) -> None:
        self.socket = connection
        self.held = b""
        self.early = 0.0
        self.alive = True

    def send(self, data: bytes) -> bool:
        """Send all of it; False when the connection is gone or nobody reads."""
        if not self.alive:
            return False
        try:
            return self.socket.send(data) == len(data)
        except OSError:
            return False


class TcpServer:
    """Listens on a free port of this computer.

    Parameters
    ----------
    loop, log
        Of the trial.
    on_data
        Called with a client whose `held` has grown, and when.
    """

    def __init__(self, loop: Loop, log: WireLog, on_data: Callable[[Client, Moment], None]) -> None:
        self._loop = loop
        self._log = log
        self._on_data = on_data
        self._listener: socket.socket | None = None
        self.port = 0
        self.clients: list[Client] = []

    def listen(self) -> None:
        """Let clients in; always on the same port. Safe to call twice."""
        if self._listener is not None:
            return
        listener = socket.socket()
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("127.0.0.1", self.port))
        listener.listen(8)
        listener.setblocking(False)
        self.port = listener.getsockname()[1]
        self._listener = listener
        self._loop.watch(listener.fileno(), lambda _: self._accept())

    def cut(self) -> None:
        """Reset all connections and listen no more."""
        if self._listener is not None:
            self._loop.forget(self._listener.fileno())
            self._listener.close()
            self._listener = None
        for client in list(self.clients):
            self.drop(client)

    def drop(self, client: Client) -> None:
        """Reset one connection."""
        if client.alive:
            client.alive = False
            self.clients.remove(client)
            self._loop.forget(client.socket.fileno())
            with contextlib.suppress(OSError):
                linger = struct.pack("ii", 1, 0)
                client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
            client.socket.close()

    def _accept(self) -> None:
        if self._listener is None:
            return
        with contextlib.suppress(OSError):
            connection, _ = self._listener.accept()
            connection.setblocking(False)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client = Client(connection)
            self.clients.append(client)
            self._loop.watch(connection.fileno(), lambda moment: self._readable(client, moment))

    def _readable(self, client: Client, moment: Moment) -> None:
        try:
            data = client.socket.recv(65536)
        except OSError:
            data = b""
        if not data:
            self.drop(client)
            return
        self._log.say("<", data)
        if not client.held:
            client.early = moment.early
        client.held += data
        self._on_data(client, Moment(client.early, moment.late))
