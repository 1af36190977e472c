"""A relay: another address for a server, as it has one for another computer."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager


def _carry(client: socket.socket, port: int, closing: socket.socket) -> None:
    """Carry bytes both ways until one side, or the relay, ends."""
    with (
        contextlib.suppress(OSError),
        client,
        socket.create_connection(("127.0.0.1", port), timeout=10.0) as server,
    ):
        other = {client: server, server: client}
        for end in other:
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while True:
            ready, _, _ = select.select([*other, closing], [], [])
            if closing in ready:
                return
            for end in ready:
                data = end.recv(65536)
                if not data:
                    return
                other[end].sendall(data)


@contextmanager
def relay(port: int) -> Iterator[int]:
    """A port that leads to `port` of this computer, and is not known to be the same."""
    threads: list[threading.Thread] = []
    close, closing = socket.socketpair()

    def serve() -> None:
        while True:
            ready, _, _ = select.select([listener, closing], [], [])
            if closing in ready:
                return
            client, _ = listener.accept()
            threads.append(threading.Thread(target=_carry, args=(client, port, closing)))
            threads[-1].start()

    with close, closing, socket.create_server(("127.0.0.1", 0)) as listener:
        threads.append(threading.Thread(target=serve))
        threads[0].start()
        try:
            yield listener.getsockname()[1]
        finally:
            close.send(b".")
            for thread in threads:
                thread.join()
