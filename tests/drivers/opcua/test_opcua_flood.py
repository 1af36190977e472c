"""An OPC UA server that sends without end: neither memory nor the loop pays for it."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from abbe.drivers.link import LinkState
from abbe.drivers.opcua.incoming import MOST_BYTES, IncomingChunks
from tests.support.drivers.opcua.mill import Mill, linked
from tests.support.drivers.opening import until

Flood = Callable[[bytes], Iterator[bytes]]


def claimed(_: bytes) -> Iterator[bytes]:
    """Two gigabytes are announced, and come."""
    yield b"MSGF" + struct.pack("<I", 0x7FFFFFFF)
    while True:
        yield bytes(1 << 20)


def trickled(_: bytes) -> Iterator[bytes]:
    """The same, a few bytes at a time."""
    yield b"MSGF" + struct.pack("<I", 0x7FFFFFFF)
    while True:
        yield bytes(2000)


def _chunks(kind: bytes, body: bytes) -> Flood:
    def flood(answer: bytes) -> Iterator[bytes]:
        channel, token, number, request = struct.unpack("<IIII", (answer + bytes(24))[8:24])
        while True:
            together = bytearray()
            while len(together) < 1 << 18:
                head = struct.pack("<IIIII", 24 + len(body), channel, token, number, request)
                together += b"MSG" + kind + head + body
                number += 1
            yield bytes(together)

    return flood


FLOODS = {
    "2 GB claimed": claimed,
    "2 GB claimed, in pieces": trickled,
    "an answer that never ends": _chunks(b"C", bytes(8000)),
    "an answer of small pieces that never ends": _chunks(b"C", b""),
    "answers broken off": _chunks(b"A", struct.pack("<Ii", 0x80000000, -1)),
}


class FloodedWire:
    """Between link and server, in threads of its own: hands on, or floods instead.

    Attributes
    ----------
    flood
        What is sent instead of what the server says, by its next answer; None: nothing is.
    sent
        Bytes of floods that were taken off.
    """

    def __init__(self, server: int) -> None:
        self._server = server
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        self.flood: Flood | None = None
        self.sent = 0
        self._sockets: list[socket.socket] = [self._listening]

    def __enter__(self) -> FloodedWire:
        self._start(self._serve)
        return self

    def __exit__(self, *_: object) -> None:
        for each in self._sockets:
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _start(self, target: Callable[..., None], *args: socket.socket) -> None:
        threading.Thread(target=target, args=args, daemon=True).start()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listening.accept()
                server = socket.create_connection(("127.0.0.1", self._server))
                self._sockets += client, server
                self._start(self._hand_on, client, server)
                self._start(self._answer, server, client)

    def _hand_on(self, client: socket.socket, server: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := client.recv(65536):
                server.sendall(data)
            server.shutdown(socket.SHUT_RDWR)

    def _answer(self, server: socket.socket, client: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := server.recv(65536):
                if data.startswith(b"ACKF"):
                    # the server agrees to no limits, 0 says
                    data = data[:20] + bytes(8) + data[28:]
                if self.flood is None:
                    client.sendall(data)
                    continue
                for piece in self.flood(data):
                    client.sendall(piece)
                    self.sent += len(piece)
        with contextlib.suppress(OSError):
            client.shutdown(socket.SHUT_RDWR)


class Watched:
    """What the loop and the memory of this process pay, looked at every few ms."""

    def __init__(self) -> None:
        self.lag = 0.0
        self.before = self.most = _resident()

    async def run(self) -> None:
        """Look until cancelled."""
        while True:
            began = time.monotonic()
            await asyncio.sleep(0.005)
            self.lag = max(self.lag, time.monotonic() - began - 0.005)
            self.most = max(self.most, _resident())

    @property
    def grown(self) -> int:
        """Bytes of memory at most beyond those at first."""
        return self.most - self.before


def _resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


@pytest.mark.one_in(4)
@pytest.mark.integration
@pytest.mark.parametrize("flood", FLOODS.values(), ids=FLOODS)
async def test_a_flood_costs_neither_memory_nor_the_loop(server: Mill, flood: Flood) -> None:
    with FloodedWire(server.port) as wire:
        async with linked(f"opc.tcp://127.0.0.1:{wire.port}", {"x": "x"}) as link:
            assert (await link.read(("x",)))["x"].good
            watched = Watched()
            watching = asyncio.create_task(watched.run())
            await asyncio.sleep(0.02)
            wire.flood = flood
            found = (await link.read(("x",)))["x"]
            assert not found.good
            assert "the server sent too much" in found.reason
            # flooded at every connection, too
            floods = wire.sent
            await until(lambda: link.status.state is LinkState.DOWN)
            await asyncio.sleep(0.5)
            wire.flood = None
            await until(lambda: link.status.state is LinkState.UP)
            assert (await link.read(("x",)))["x"].value == 1.5
            watching.cancel()
            assert wire.sent >= floods
    assert watched.grown < 32 << 20
    assert watched.lag < 1.0


def _cut(pieces: list[bytes]) -> tuple[list[bytes], IncomingChunks, list[bool]]:
    taken: list[bytes] = []
    ended: list[bool] = []
    incoming = IncomingChunks(taken.append, lambda: ended.append(True))
    for piece in pieces:
        incoming.data_received(piece)
    return taken, incoming, ended


@pytest.mark.parametrize("step", [1, 3, 8, 9, 1000])
def test_chunks_are_handed_on_whole_however_they_come(step: int) -> None:
    chunks = [
        b"MSG" + kind + struct.pack("<I", 8 + size) + bytes(size)
        for kind, size in [(b"F", 0), (b"C", 20), (b"F", 1), (b"A", 700), (b"F", 16)]
    ]
    sent = b"".join(chunks)
    taken, incoming, ended = _cut([sent[at : at + step] for at in range(0, len(sent), step)])
    assert taken == chunks
    assert not ended
    assert incoming.why == ""


def test_a_long_answer_is_taken_and_a_longer_one_is_not() -> None:
    size = 32768
    part = struct.pack("<I", size) + bytes(size - 8)
    parts = MOST_BYTES // size
    answer = [b"MSGC" + part] * (parts - 1) + [b"MSGF" + part]
    taken, _, ended = _cut(answer * 3)
    assert len(taken) == 3 * parts
    assert not ended
    taken, incoming, ended = _cut([b"MSGC" + part] * 100)
    assert len(taken) == parts
    assert ended == [True]
    assert "524288 bytes" in incoming.why


@pytest.mark.parametrize("size", [0, 7, 65536, 0xFFFFFFFF])
def test_sizes_that_nobody_agreed_on_are_none(size: int) -> None:
    taken, incoming, ended = _cut([b"MSGF" + struct.pack("<I", size) + bytes(100)])
    assert not taken
    assert ended == [True]
    assert f"a piece of {size} bytes" in incoming.why
