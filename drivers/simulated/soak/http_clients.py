"""Clients of an HTTP interface, in a process of their own: readers, silent ones, one with rubbish.

``python -m abbe.drivers.simulated.soak.http_clients SOCKET EVERY [PORT TOKEN]`` asks until its
standard input ends. A line ``go`` there has all of them ask; ``rest`` has them close what they
opened, and is answered by one line of JSON, `ClientCounts`.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import os
import random
import re
import select
import socket
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, field

READERS, SILENT = 20, 5
"""Clients that ask and read the answer; that ask and never read. One more sends rubbish."""
_AGAIN = 0.5
"""s between two questions of one client."""
_NICER = 15
"""By how much they step back: they stand for programs on other computers."""
_WITHIN = 60.0
"""s for an answer to be whole, on a busy computer."""
_PATHS = (
    "/healthz", "/readyz", "/metrics", "/api/v1/status", "/api/v1/axes", "/api/v1/signals",
    "/api/v1/links", "/", "/api/v1/cycles?every={every}", "/api/v1/cycles",
)  # fmt: skip
_STREAM = "/api/v1/cycles"
_EVENT = re.compile(rb"event: cycle\nid: (\d+)\ndata: (\{.*\})\n\n")
_HEAD = re.compile(rb"HTTP/1\.1 (\d{3}) ")


@dataclass
class ClientCounts:
    """What clients have met.

    Attributes
    ----------
    answers
        Kind (health, metrics, api, page, cycles) → whole answers; of streams: events.
    cut
        How often one that never reads was cut off.
    rubbish
        How often rubbish was sent.
    gone
        Connections that ended in the middle, or could not be made: Abbe was not there.
    wrong
        Answers that are none: another status than 200 and 503, or an event out of order; the first
        of them.
    more
        How many more there were.
    """

    answers: dict[str, int] = field(default_factory=dict)
    cut: int = 0
    rubbish: int = 0
    gone: int = 0
    wrong: list[str] = field(default_factory=list)
    more: int = 0

    def answered(self, path: str) -> None:
        """One more answer to a path."""
        kind = "page" if path == "/" else path.split("/")[1].split("?")[0]
        kind = "health" if kind in ("healthz", "readyz") else kind
        kind = "cycles" if path.startswith(_STREAM) else kind
        self.answers[kind] = self.answers.get(kind, 0) + 1

    def amiss(self, text: str) -> None:
        """Note an answer that is none; the first of them tell enough."""
        if len(self.wrong) < 20:
            self.wrong.append(text)
        else:
            self.more += 1


class AskingClients:
    """All clients of one interface.

    Parameters
    ----------
    path
        Its Unix socket.
    every
        s between two cycles of the fastest streams; 0: every one.
    port, token
        Where else it listens on this computer, and what it takes there; 0: nowhere.
    """

    def __init__(self, path: str, every: float, port: int = 0, token: str = "") -> None:
        self._path, self._every, self._port, self._token = path, every, port, token
        self._tasks: list[asyncio.Task[None]] = []
        self.counts = ClientCounts()

    def go(self) -> None:
        """All begin to ask."""
        if not self._tasks:
            clients = [self._reader(n) for n in range(READERS)]
            clients += [self._silent(n) for n in range(SILENT)]
            self._tasks = [asyncio.create_task(c) for c in (*clients, self._rubbish())]

    async def rest(self) -> None:
        """All close what they have opened."""
        for task in self._tasks:
            task.cancel()
        for done in await asyncio.gather(*self._tasks, return_exceptions=True):
            if isinstance(done, Exception):
                self.counts.amiss(f"a client failed: {done!r}")
        self._tasks = []

    def _request(self, path: str, network: bool) -> bytes:
        token = f"authorization: Bearer {self._token}\r\n" if network else ""
        path = path.format(every=self._every)
        return f"GET {path} HTTP/1.1\r\nhost: abbe\r\n{token}".encode()

    async def _connection(
        self, *, network: bool
    ) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        if network:
            return await asyncio.open_connection("127.0.0.1", self._port)
        return await asyncio.open_unix_connection(self._path)

    async def _reader(self, number: int) -> None:
        path = _PATHS[number % len(_PATHS)]
        network = bool(self._port) and number >= len(_PATHS)
        await asyncio.sleep(number * _AGAIN / READERS)
        while True:
            try:
                await self._ask(path, network)
            except (OSError, asyncio.IncompleteReadError, TimeoutError):
                self.counts.gone += 1
            await asyncio.sleep(_AGAIN)

    async def _ask(self, path: str, network: bool) -> None:
        reader, writer = await self._connection(network=network)
        try:
            writer.write(self._request(path, network) + b"connection: close\r\n\r\n")
            async with asyncio.timeout(_WITHIN):
                head = await reader.readuntil(b"\r\n\r\n")
            found = _HEAD.match(head)
            if found is None or found[1] not in (b"200", b"503"):
                self.counts.amiss(f"{path}: {head[:80]!r}")
            elif path.startswith(_STREAM) and found[1] == b"200":
                await self._events(path, reader)
            else:
                length = re.search(rb"content-length: (\d+)", head)
                async with asyncio.timeout(_WITHIN):
                    await reader.readexactly(int(length[1]) if length else 0)
                self.counts.answered(path)
        finally:
            writer.close()

    async def _events(self, path: str, reader: asyncio.StreamReader) -> None:
        """Read a stream to its end; cycles come in order and whole."""
        last, rest = -1, b""
        while data := await reader.read(65536):
            rest += data
            end = 0
            for event in _EVENT.finditer(rest):
                end = event.end()
                number = int(event[1])
                if number <= last or json.loads(event[2])["cycle"] != number:
                    self.counts.amiss(f"{path}: cycle {number} after {last}")
                last = number
                self.counts.answered(path)
            rest = rest[end:]

    async def _silent(self, number: int) -> None:
        """Ask for more than fits anywhere, read nothing, until cut off."""
        question = self._request("/api/v1/cycles?every={every}", False) + b"\r\n"
        if number % 2:
            question = (self._request("/api/v1/status", False) + b"\r\n") * 100
        while True:
            made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
            with made, contextlib.suppress(OSError):
                made.connect(self._path)
                # what finds no room is left out
                made.send(question)
                poll = select.poll()
                poll.register(made, 0)
                while not poll.poll(0):  # noqa: ASYNC110 (no event tells that one is cut off)
                    await asyncio.sleep(_AGAIN)
                self.counts.cut += 1
            await asyncio.sleep(_AGAIN)

    async def _rubbish(self) -> None:
        chance = random.Random(26)
        kinds: list[Callable[[], bytes]] = [
            lambda: os.urandom(3000),
            lambda: b"GET / HTTP/1.1\r\nhost: abbe\r\nx: " + b"y" * 40_000,
            lambda: b"POST /api/v1/switch HTTP/1.1\r\nhost: abbe\r\ncontent-length: -1\r\n\r\n{",
            lambda: self._request("/api/v1/cycles?every=nan", False) + b"\r\n",
            lambda: b"\x16\x03\x01\x02\x00\x01\x00" + os.urandom(500),
        ]
        for turn in itertools.count():
            with contextlib.suppress(OSError, TimeoutError):
                reader, writer = await self._connection(network=bool(self._port and turn % 2))
                try:
                    writer.write(chance.choice(kinds)())
                    self.counts.rubbish += 1
                    async with asyncio.timeout(_AGAIN):
                        await reader.read()
                finally:
                    writer.close()
            await asyncio.sleep(_AGAIN)


async def main(path: str, every: float, port: int, token: str) -> None:
    """Do what standard input says, until it ends."""
    clients = AskingClients(path, every, port, token)
    lines = asyncio.StreamReader()
    loop = asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(lines), sys.stdin)
    while line := await lines.readline():
        if line.strip() == b"go":
            clients.go()
        else:
            await clients.rest()
            sys.stdout.write(json.dumps(asdict(clients.counts)) + "\n")
            sys.stdout.flush()
    await clients.rest()


if __name__ == "__main__":
    os.nice(_NICER)
    _path, _every, *_network = sys.argv[1:]
    _port, _token = _network or ("0", "")
    asyncio.run(main(_path, float(_every), int(_port), _token))
