"""A simulated control's table memory on a serial line: commands in ASCII, tapes both ways.

Lines end with CR LF and carry ``*`` and the exclusive or of what is before it; a line without is
not answered. The tape's blocks: number, 45 bytes as base64, CRC-32 of number and bytes.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import re
import zlib
from collections.abc import Callable
from pathlib import Path

from abbe.drivers.simulated.controller.table_faults import Faults, TableFault
from abbe.drivers.simulated.controller.table_memory import (
    NO,
    ControlRefusesError,
    PowerFailsError,
    TableMemory,
)
from abbe.drivers.simulated.controller.table_registers import NAME, SERIAL
from abbe.drivers.simulated.controller.tape_reader import TapeReader
from abbe.drivers.simulated.pseudo_terminals.pty_port import PtyPort

CAN = 0x18
_BYTES = 45
_RATE, _BUFFER = 400_000.0, 2048
_BLOCK = re.compile(r"N(\d{5}) ([A-Za-z0-9+/=]+) ([0-9A-F]{8})")
_DONE = 0.002
"""s between two looks at whether a tape is complete."""
_SILENT = ("lost_answer", "lost_request", "hang", "hang_after")


class _StoringReader(TapeReader):
    """The tape reader, each block handed over as it is stored; a block may fail."""

    on_block: Callable[[str], str | None] = staticmethod(lambda block: block)
    deaf = False

    def receive(self, data: bytes) -> None:
        """Characters from the line; none when it hangs."""
        if not self.deaf:
            super().receive(data)

    def _store(self, block: str) -> None:
        stored = self.on_block(block)
        if stored is not None:
            super()._store(stored)


class TableLines:
    """One control on one line.

    Parameters
    ----------
    memory
        The controller.
    faults
        What goes wrong.
    link
        Path of the port.
    """

    def __init__(self, memory: TableMemory, faults: Faults, link: Path) -> None:
        self.memory = memory
        self.faults = faults
        self.protected = False
        self.port = PtyPort(link, self._receive)
        self._held = b""
        self._silent = False
        self._tasks: set[asyncio.Task[None]] = set()
        self._begin_tape()

    def _begin_tape(self) -> None:
        self._reader = _StoringReader(self._say, _RATE, _BUFFER, "checksum")
        self._reader.on_block = self._block
        self._reading = False
        self._spoilt: TableFault | None = None

    def restart(self) -> None:
        """Off and on again."""
        self.memory.restart()
        self._held = b""
        self._begin_tape()

    def wake(self) -> None:
        """Answer again."""
        self._silent = False
        self._begin_tape()
        self.port.plug()

    async def work(self) -> None:
        """Take characters of tapes, for ever."""
        while True:
            reader = self._reader
            task = asyncio.ensure_future(reader.work())
            while reader is self._reader:
                await asyncio.sleep(_DONE)
                if self._reading and reader.complete:
                    self._begin_tape()
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    # the line

    def _receive(self, data: bytes) -> None:
        if CAN in data:
            data = data[data.rindex(CAN) + 1 :]
            self._held = b""
            for task in self._tasks:
                task.cancel()
            self._begin_tape()
        if self._silent:
            return
        if self._reading:
            self._reader.receive(data)
            return
        *lines, self._held = (self._held + data).split(b"\r\n")
        for line in lines:
            body, star, sum_ = line.rpartition(b"*")
            if star and sum_ == b"%02X" % _xor(body):
                self._command(body.decode("latin-1"))

    def _say(self, data: bytes) -> None:
        if not self._silent:
            self.port.send(data)

    def _answer(self, text: str, fault: TableFault | None) -> None:
        body = text.encode("ascii")
        line = body + b"*%02X\r\n" % _xor(body)
        kind = "" if fault is None else fault.kind
        if kind == "bad_answer":
            line = line[:4] + bytes((line[4] ^ 0x02,)) + line[5:]
        if kind == "late_answer" and fault is not None:
            asyncio.get_running_loop().call_later(fault.seconds, self._say, line)
        elif kind not in _SILENT:
            self._say(line * 2 if kind == "twice" else line)

    # commands

    def _command(self, line: str) -> None:
        word, _, rest = line.partition(" ")
        name = {
            "ID?": "identity", "STATE?": "state", "TABLES?": "status", "SHOW?": "show",
            "RECEIVE": "begin", "ACTIVATE": "commit", "DISCARD": "discard",
            "DEACTIVATE": "deactivate",
        }.get(word) or ("read_active" if rest == "ACTIVE" else "read_staged")  # fmt: skip
        fault = self.faults.take(name)
        kind = "" if fault is None else fault.kind
        if kind == "refuses":
            self._answer("ERROR PROTECTED", None)
            return
        if fault is not None and kind == "restart":
            self._fail(fault)
            return
        if kind not in ("lost_request", "bad_request", "hang"):
            self._do(name, rest, fault)
        if kind in ("hang", "hang_after"):
            self._silent = True
        if fault is not None and kind in ("restart_after", "restart_amid"):
            self._fail(fault)

    def _do(self, name: str, rest: str, fault: TableFault | None) -> None:
        memory, lies = self.memory, fault is not None and fault.kind == "lies"
        if name == "begin":
            self._begin(rest, fault)
        elif name in ("read_staged", "read_active"):
            self._send(memory.staged if name == "read_staged" else memory.active, fault)
        elif name == "identity":
            self._answer(f"ID {NAME};{'SIM-9999' if lies else SERIAL}", fault)
        elif name == "state":
            idle, referenced = memory.idle != lies, memory.referenced != lies
            self._answer(
                f"STATE IDLE={idle:d} REFERENCED={referenced:d} PROTECTED={self.protected:d}", fault
            )
        elif name == "status":
            staged, active = memory.staged, memory.active
            crc = zlib.crc32(staged) if memory.whole else 0
            self._answer(
                f"TABLES STAGED={len(staged)},{crc:08X} "
                f"ACTIVE={len(active)},{zlib.crc32(active) ^ lies:08X}",
                fault,
            )
        elif name == "show":
            position, direction, correction = memory.step()
            self._answer(
                "SHOW " + ";".join(
                    f"{axis},{direction[axis]},{place:.6f},{correction[axis] + 0.02 * lies:.9f}"
                    for axis, place in position.items()
                ),
                fault,
            )  # fmt: skip
        else:
            self._change(name, rest, fault)

    def _change(self, name: str, rest: str, fault: TableFault | None) -> None:
        """Commands that change what is active, or empty the staging area."""
        memory, kind = self.memory, "" if fault is None else fault.kind
        said = {"commit": "ACTIVATED", "discard": "DISCARDED", "deactivate": "DEACTIVATED"}[name]
        if kind == "lies":
            self._answer(said, None)
            return
        memory.fail_amid = kind == "restart_amid"
        try:
            if self.protected and name != "discard":
                raise ControlRefusesError(NO)
            for _ in range(2 if kind == "twice" else 1):
                if name == "commit":
                    length, crc = rest.split()
                    memory.commit(int(length), int(crc, 16))
                elif name == "discard":
                    memory.discard()
                else:
                    memory.deactivate()
        except ControlRefusesError as error:
            said = f"ERROR {error.code} {error}".encode("ascii", "replace").decode()
        except PowerFailsError:
            return
        self._answer(said, fault)

    # tapes

    def _begin(self, rest: str, fault: TableFault | None) -> None:
        length, crc = rest.split()
        try:
            self.memory.begin(self.memory.session % 99 + 1, int(length), int(crc, 16))
        except ControlRefusesError as error:
            self._answer(f"ERROR {error.code} {error}", None)
            return
        if fault is not None and fault.kind == "lies":
            self.memory.discard()
        self._begin_tape()
        self._reading = True
        if fault is None or fault.kind in ("twice", "lies", "bad_answer"):
            self._reader.read()
        elif fault.kind == "late_answer":
            asyncio.get_running_loop().call_later(fault.seconds, self._reader.read)

    def _block(self, block: str) -> str | None:
        fault = self.faults.take("block")
        kind = "" if fault is None else fault.kind
        if kind == "bad_request":
            block = block.replace("A", "B", 1)
        if fault is not None and kind in ("restart", "restart_after"):
            self._fail(fault)
            return None
        if kind == "refuses":
            self._reader.alarm("ERROR 8 PROTECTED")
        if kind in ("lost_request", "refuses"):
            return None
        match = _BLOCK.fullmatch(block)
        part = base64.b64decode(match[2]) if match else b""
        if match and zlib.crc32(f"N{match[1]} ".encode() + part) == int(match[3], 16):
            if kind == "lies":
                part = bytes((part[0] ^ 1,)) + part[1:]
            offset = (int(match[1]) - 1) * _BYTES
            with contextlib.suppress(ControlRefusesError):
                self.memory.put(self.memory.session, offset, part)
        if kind == "twice":
            self._reader.stored.append(block)
        if kind in ("hang", "hang_after", "lost_answer"):
            # nothing is said any more; after a lost answer until the next transfer is begun
            self._silent = kind != "lost_answer"
            self._reader.deaf = True
        if kind == "bad_answer":
            self._reader._tape += b"?"
        return block

    def _send(self, image: bytes, fault: TableFault | None) -> None:
        kind = "" if fault is None else fault.kind
        if kind in _SILENT and kind != "hang_after":
            return
        if kind == "lies" and image:
            image = image[:200] + bytes((image[200] ^ 1,)) + image[201:]
        blocks = []
        for number, at in enumerate(range(0, len(image), _BYTES), start=1):
            part = image[at : at + _BYTES]
            head = f"N{number:05d} "
            crc = zlib.crc32(head.encode() + part)
            blocks.append(f"{head}{base64.b64encode(part).decode()} {crc:08X}")
        if kind == "bad_answer":
            blocks[2] = blocks[2].swapcase()
        if kind == "twice":
            blocks.insert(3, blocks[2])
        self._reader.stored = blocks
        task = asyncio.get_running_loop().create_task(self._punch(fault))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _punch(self, fault: TableFault | None) -> None:
        if fault is not None and fault.kind == "late_answer":
            await asyncio.sleep(fault.seconds)
        tape = b"%\n" + b"".join(b.encode() + b"\n" for b in self._reader.stored) + b"%"
        for at in range(0, len(tape), 256):
            self._say(tape[at : at + 256])
            await asyncio.sleep(0.0)

    def _fail(self, fault: TableFault) -> None:
        self.port.unplug()
        self.restart()
        asyncio.get_running_loop().call_later(fault.seconds, self.port.plug)


def _xor(body: bytes) -> int:
    total = 0
    for byte in body:
        total ^= byte
    return total
