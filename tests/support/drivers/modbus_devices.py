"""Modbus devices written from the specification, without pymodbus, that misbehave on request."""

from __future__ import annotations

import asyncio
import os
import pty
import select
import struct
import threading
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass, field

TABLES = {1: "coil", 2: "discrete", 3: "holding", 4: "input"}


@dataclass
class Request:
    unit: int
    function: int
    address: int
    count: int


@dataclass
class Memory:
    """Registers and bits of all units, and the log of requests. At first register N holds N."""

    units: tuple[int, ...] = (1,)
    size: int = 300
    silent: set[int] = field(default_factory=set)
    forbidden: Callable[[Request], int] = lambda request: 0
    requests: list[Request] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.words = {
            (unit, table): list(range(self.size))
            for unit in self.units
            for table in ("holding", "input")
        }
        self.bits = {
            (unit, table): [n % 3 == 0 for n in range(self.size)]
            for unit in self.units
            for table in ("coil", "discrete")
        }

    def answer(self, unit: int, pdu: bytes) -> bytes | None:
        """One request's answer; None where the unit stays silent."""
        function, address, count = struct.unpack(">BHH", pdu[:5])
        if function in (5, 6):
            count = 1
        request = Request(unit, function, address, count)
        self.requests.append(request)
        if unit in self.silent or unit not in self.units:
            return None
        if code := self.forbidden(request):
            return bytes((function | 0x80, code))
        if address + count > self.size:
            return bytes((function | 0x80, 2))
        if function in (3, 4):
            words = self.words[unit, TABLES[function]][address : address + count]
            return struct.pack(f">BB{count}H", function, 2 * count, *words)
        if function in (1, 2):
            bits = self.bits[unit, TABLES[function]][address : address + count]
            packed = bytearray((count + 7) // 8)
            for i, bit in enumerate(bits):
                packed[i // 8] |= bit << i % 8
            return bytes((function, len(packed))) + bytes(packed)
        if function == 6:
            self.words[unit, "holding"][address] = struct.unpack(">H", pdu[3:5])[0]
        elif function == 16:
            words = struct.unpack(f">{count}H", pdu[6:])
            self.words[unit, "holding"][address : address + count] = words
        elif function == 5:
            self.bits[unit, "coil"][address] = pdu[3:5] == b"\xff\x00"
        elif function == 15:
            self.bits[unit, "coil"][address : address + count] = [
                bool(pdu[6 + i // 8] >> i % 8 & 1) for i in range(count)
            ]
        else:
            return bytes((function | 0x80, 1))
        return pdu[:5]


class TcpDevice:
    """A Modbus TCP device in this event loop, on a port of its own choice."""

    def __init__(self, memory: Memory | None = None) -> None:
        self.memory = memory or Memory()
        self.port = 0
        self.frozen = False
        self.connections = 0
        self.dead_connections: set[int] = set()
        """Numbers (from 1) of connections on which nothing is ever answered."""
        self.tamper: Callable[[int, bytes, bytes], list[bytes | float] | None] | None = None
        """(unit, request PDU, answer frame) → what to send: bytes, pauses in s, −1 hangs up."""
        self._server: asyncio.Server | None = None
        self._writers: set[asyncio.StreamWriter] = set()
        self._tasks: set[asyncio.Task[None]] = set()

    async def __aenter__(self) -> TcpDevice:
        await self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.stop()

    async def start(self) -> None:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", self.port)
        self.port = self._server.sockets[0].getsockname()[1]

    async def stop(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None
        for writer in list(self._writers):
            writer.transport.abort()
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        self._writers.add(writer)
        self.connections += 1
        number = self.connections
        try:
            while True:
                head = await reader.readexactly(7)
                transaction, _, length, unit = struct.unpack(">HHHB", head)
                pdu = await reader.readexactly(length - 1)
                answer = self.memory.answer(unit, pdu)
                if answer is None or self.frozen or number in self.dead_connections:
                    continue
                frame = struct.pack(">HHHB", transaction, 0, len(answer) + 1, unit) + answer
                parts = self.tamper(unit, pdu, frame) if self.tamper else None
                for part in [frame] if parts is None else parts:
                    if isinstance(part, bytes):
                        writer.write(part)
                        await writer.drain()
                    elif part < 0:
                        return
                    else:
                        await asyncio.sleep(part)
        except (asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
            pass
        finally:
            writer.close()
            self._writers.discard(writer)
            self._tasks.discard(task)


def crc(data: bytes) -> bytes:
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0xA001 if value & 1 else value >> 1
    return value.to_bytes(2, "little")


class RtuDevice:
    """Modbus RTU units on one pseudo-terminal, in a thread; each answers its requests in turn.

    `delay` is asked for every request: s until the answer. `prefix`: noise in front of it. One that
    is `behind` answers each request when the next one comes.
    """

    def __init__(self, memory: Memory | None = None, *, echo: bool = False) -> None:
        self.memory = memory or Memory()
        self.behind = False
        self._owed: bytes = b""
        self.delay: Callable[[Request], float] = lambda request: 0.0
        self.prefix: Callable[[Request], bytes] = lambda request: b""
        self._echo = echo
        self._master, self._slave = pty.openpty()
        tty.setraw(self._master)
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self._stop = False
        self._outbox: list[tuple[float, bytes]] = []
        self._free_at: dict[int, float] = {}
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def __enter__(self) -> RtuDevice:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop = True
        self._thread.join()
        os.close(self._slave)
        os.close(self._master)

    def _run(self) -> None:
        buffer = b""
        while not self._stop:
            now = time.monotonic()
            for item in sorted(self._outbox, key=lambda item: item[0]):
                if item[0] <= now:
                    os.write(self._master, item[1])
                    self._outbox.remove(item)
            ready, _, _ = select.select([self._master], [], [], 0.002)
            if not ready:
                continue
            data = os.read(self._master, 1024)
            if self._echo:
                os.write(self._master, data)
            buffer += data
            while (size := self._frame_size(buffer)) and len(buffer) >= size:
                frame, buffer = buffer[:size], buffer[size:]
                self._handle(frame)

    @staticmethod
    def _frame_size(buffer: bytes) -> int:
        if len(buffer) < 7:
            return 0
        return 9 + buffer[6] if buffer[1] in (15, 16) else 8

    def _handle(self, frame: bytes) -> None:
        assert crc(frame[:-2]) == frame[-2:], frame.hex()
        unit, pdu = frame[0], frame[1:-2]
        answer = self.memory.answer(unit, pdu)
        request = self.memory.requests[-1]
        if answer is None:
            return
        # A unit answers in turn: never before what it owes from earlier.
        due = max(time.monotonic(), self._free_at.get(unit, 0.0)) + self.delay(request)
        self._free_at[unit] = due
        body = bytes((unit,)) + answer
        whole = self.prefix(request) + body + crc(body)
        if self.behind:
            whole, self._owed = self._owed, whole
        self._outbox.append((due, whole))
