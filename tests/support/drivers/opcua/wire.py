"""A wire between an OPC UA link and its server, that keeps back, cuts, loses and repeats."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Any

from abbe.drivers.link import Sample
from abbe.drivers.opcua.link import OpcuaLink
from tests.support.drivers.opcua.mill import Mill, linked


class Wire:
    """What lies between the link and the server.

    Attributes
    ----------
    late
        s by which what the server says is kept back.
    pieces
        Bytes that come at once; 0: as they come.
    silent
        Whether all of it is lost.
    garbage
        Bytes that are said in the server's place, once.
    again
        How messages of a subscription are answered by the content of an older one: ``whole``;
        ``restamped``, as if answered now; ``renumbered``, as if it were the next one, too.
    """

    def __init__(self, port: int) -> None:
        self.server = port
        self.port = 0
        self.late, self.pieces, self.silent, self.garbage = 0.0, 0, False, b""
        self.again = ""
        self._free = asyncio.Event()
        self._free.set()
        self._published = b""
        self._tasks: set[asyncio.Task[None]] = set()
        self._writers: set[asyncio.StreamWriter] = set()

    @asynccontextmanager
    async def running(self) -> AsyncIterator[Wire]:
        """Take connections while the context is open."""
        listening = await asyncio.start_server(self._take, "127.0.0.1", 0)
        self.port = listening.sockets[0].getsockname()[1]
        try:
            yield self
        finally:
            listening.close()
            self.cut()
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)

    @property
    def held(self) -> bool:
        """Whether what either says is kept back, in order."""
        return not self._free.is_set()

    def hold(self) -> None:
        """Keep back what either says from now on."""
        self._free.clear()

    def release(self) -> None:
        """Hand on all that was kept back at once, and what follows as it comes."""
        self._free.set()

    def cut(self) -> None:
        """Break all connections."""
        for writer in self._writers:
            writer.transport.abort()

    async def _take(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        theirs, ours = await asyncio.open_connection("127.0.0.1", self.server)
        self._writers |= {writer, ours}
        for task in (
            asyncio.create_task(self._ask(reader, ours)),
            asyncio.create_task(self._answer(theirs, writer)),
        ):
            self._tasks.add(task)

    async def _ask(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            while data := await reader.read(65536):
                await self._free.wait()
                writer.write(data)
        writer.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            while data := await reader.read(65536):
                await asyncio.sleep(self.late)
                await self._free.wait()
                data = self._repeated(data)
                if self.silent:
                    continue
                if self.garbage:
                    data, self.garbage = self.garbage, b""
                step = self.pieces or len(data)
                for at in range(0, len(data), step):
                    writer.write(data[at : at + step])
                    if self.pieces:
                        await writer.drain()
                        await asyncio.sleep(0.001)
        writer.close()

    def _repeated(self, data: bytes) -> bytes:
        """What is said instead of a message of a subscription, where it comes in one piece."""
        if data[24:28] != _PUBLISHED or len(data) != int.from_bytes(data[4:8], "little"):
            return data
        if not self.again:
            self._published = data
            return data
        old = bytearray(self._published)
        # to whom it is said: the channel, the chunk's and the request's number
        old[8:24] = data[8:24]
        if self.again != "whole":
            old[28:36] = data[28:36]
        if self.again == "renumbered":
            old[_number_at(old)] = data[_number_at(data)]
        return bytes(old)


_PUBLISHED = b"\x01\x00" + (829).to_bytes(2, "little")
"""How the body of a PublishResponse begins (Part 6, 5.2.2.9)."""


def _number_at(message: bytes) -> slice:
    """Where a PublishResponse has its message's number, behind a list of numbers."""
    at = 61 + 4 * int.from_bytes(message[56:60], "little", signed=True)
    return slice(at, at + 4)


@asynccontextmanager
async def wired(server: Mill, **keys: Any) -> AsyncIterator[tuple[Wire, OpcuaLink]]:
    """A link behind a wire."""
    wire = Wire(server.port)
    async with (
        wire.running(),
        linked(f"opc.tcp://127.0.0.1:{wire.port}", {"x": "x", "y": "y"}, **keys) as link,
    ):
        yield wire, link


async def x_of(link: OpcuaLink) -> Sample:
    return (await link.read(("x",)))["x"]


async def until_good(link: OpcuaLink) -> Sample:
    found = await x_of(link)
    deadline = time.monotonic() + 30.0
    while not found.good and time.monotonic() < deadline:
        await asyncio.sleep(0.02)
        found = await x_of(link)
    assert found.good, found.reason
    return found
