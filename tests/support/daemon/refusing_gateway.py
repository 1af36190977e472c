"""A Modbus gateway between Abbe and the simulated machine that refuses writes when told to."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from typing import Literal

Refuses = Literal["", "blocks", "all"]
_ILLEGAL_DATA_ADDRESS = 2


class RefusingGateway:
    """Forwards each request; with `refuses` = "blocks" all writes of more than one register get an
    exception, with "all" every write. It relents when it has refused `relents_after` last words: a
    0 for register 0."""

    def __init__(self, port: int) -> None:
        self._behind = port
        self.refuses: Refuses = ""
        self.relents_after = 0
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        self._open: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listening.accept()
                self._open.append(client)
                threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        with (
            contextlib.suppress(OSError, EOFError),
            client,
            socket.create_connection(("127.0.0.1", self._behind)) as server,
        ):
            while True:
                request = _frame(client)
                function = request[7]
                if self._refused(request):
                    answer = bytes((function | 0x80, _ILLEGAL_DATA_ADDRESS))
                    client.sendall(
                        request[:4] + struct.pack(">HB", 1 + len(answer), request[6]) + answer
                    )
                    continue
                server.sendall(request)
                client.sendall(_frame(server))

    def _refused(self, request: bytes) -> bool:
        if self.refuses == "" or request[7] not in (6, 16):
            return False
        several = request[7] == 16 and int.from_bytes(request[10:12]) > 1
        if not several and request[8:10] == request[-2:] == b"\0\0":
            self.relents_after -= 1
            if self.relents_after == 0:
                self.refuses = ""
        return self.refuses == "all" or several

    def close(self) -> None:
        for one in (self._listening, *self._open):
            one.close()


def _frame(source: socket.socket) -> bytes:
    head = _exactly(source, 6)
    return head + _exactly(source, int.from_bytes(head[4:6]))


def _exactly(source: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        part = source.recv(count - len(data))
        if not part:
            raise EOFError
        data += part
    return data
