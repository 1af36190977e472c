"""A simulated controller's table memory as Modbus registers: status, commands, two windows.

All are holding registers, numbers big-endian, high word first.

=======  =====  ================================================================================
address  words  content
=======  =====  ================================================================================
0        16     name, ASCII
16       8      serial number, ASCII
24       1      state: bit 0 idle, 1 referenced, 2 protected
32       18     session, staged length (2) and CRC-32 (2), active length (2) and CRC-32 (2),
                last block's sequence, offset (2) and CRC-32 (2), last command's token and
                result, three spare
64       7      command: token, command (1 begin, 2 commit, 3 discard, 4 deactivate),
                length (2), CRC-32 (2), check
128      7 + n  block: session, sequence, offset (2), bytes, CRC-32 (2), then the bytes
256      3      pointer: area (0 staged, 1 active), offset (2)
260      6 + n  window: area, offset (2), bytes, CRC-32 of all else (2), then the bytes
400      33     shown: number of axes, for each its letter, direction, position and correction
                in mm (float64), then the CRC-32 of all before
=======  =====  ================================================================================

The check is the low half of the CRC-32 of the words before it; a command without is ignored, and so
is a block whose CRC-32 (of session to bytes, and the bytes) is wrong: the result says so.
"""

from __future__ import annotations

import contextlib
import struct
import time
import zlib
from collections.abc import Callable, Sequence
from typing import ClassVar

from abbe.drivers.simulated.bridge.device import (
    NotWritableError,
    Ranges,
    RefusedRequestError,
    WireFaults,
)
from abbe.drivers.simulated.controller.table_faults import Faults, TableFault
from abbe.drivers.simulated.controller.table_memory import (
    CHECKSUM,
    NO,
    ControlRefusesError,
    PowerFailsError,
    TableMemory,
)
from abbe.drivers.simulated.registers import Table

UNIT_ID = 1
NAME, SERIAL = "ABBE SIMULATED CONTROL 1.0", "SIM-4711"
STATE, STATUS, COMMAND, BLOCK, POINTER, WINDOW, SHOWN = 24, 32, 64, 128, 256, 260, 400
_STATUS = struct.Struct(">HIIIIHIIHH6x")
_COMMAND = struct.Struct(">HHIIH")
_BLOCK = struct.Struct(">HHIHI")
_WINDOW = struct.Struct(">HIHI")
_WINDOW_WORDS = 125
_SHOWN_WORDS = 1 + 3 * 10 + 2
_DONE = 1
_DEVICE_FAILURE = 4


class TableDevice:
    """The registers of one `TableMemory`.

    Parameters
    ----------
    memory
        The controller.
    faults
        What goes wrong.
    """

    ranges: ClassVar[Ranges] = {
        "coil": ((0, 16),),
        "discrete": ((0, 16),),
        "holding": (
            (0, 25),
            (STATUS, _STATUS.size // 2),
            (COMMAND, _COMMAND.size // 2),
            (BLOCK, 123),
            (POINTER, 3),
            (WINDOW, _WINDOW_WORDS),
            (SHOWN, _SHOWN_WORDS),
        ),
        "input": ((0, 1),),
    }

    def __init__(self, memory: TableMemory, faults: Faults) -> None:
        self.memory = memory
        self.faults = faults
        self.wire = WireFaults()
        self.protected = False
        self._forget()

    def _forget(self) -> None:
        self._block = (0, 0, 0)
        self._result = (0, 0)
        self._pointer = (0, 0)

    def restart(self) -> None:
        """Off and on again."""
        self.memory.restart()
        self._forget()

    def wake(self) -> None:
        """Answer again."""
        self.wire.silent_until = 0.0

    # requests

    def read(self, table: Table, address: int, count: int, now: float) -> list[int]:
        """Words of a request that lies within `ranges`."""
        if table != "holding":
            return [0] * count
        if address >= SHOWN:
            return self._reading("show", SHOWN, self._shown, address, count)
        if address >= WINDOW:
            area = "read_active" if self._pointer[0] else "read_staged"
            return self._reading(area, WINDOW, self._window, address, count)
        if STATUS <= address < COMMAND:
            return self._reading("status", STATUS, self._status, address, count)
        if address == STATE:
            return self._reading("state", STATE, self._state, address, count)
        if address < STATE:
            return self._reading("identity", 0, self._identity, address, count)
        return [0] * count

    def write(self, table: Table, address: int, values: Sequence[int], now: float) -> None:
        """Take words in."""
        if table != "holding":
            raise NotWritableError(table)
        data = struct.pack(f">{len(values)}H", *values)
        if address == POINTER:
            area, offset = struct.unpack(">HI", data)
            self._pointer = (area, offset)
        elif address == COMMAND and len(data) == _COMMAND.size:
            names = {1: "begin", 2: "commit", 3: "discard", 4: "deactivate"}
            self._writing(names.get(values[1], "status"), data, self._command)
        elif address == BLOCK and len(data) >= _BLOCK.size:
            self._writing("block", data, self._put)
        else:
            raise NotWritableError(f"{table} {address}")

    # what may go wrong

    def _reading(
        self, operation: str, start: int, make: Callable[[bool], bytes], address: int, count: int
    ) -> list[int]:
        fault = self.faults.take(operation)
        if fault is not None:
            self._before(fault)
        lies = fault is not None and fault.kind == "lies"
        data = make(lies)
        if fault is not None:
            self._after(fault)
        words = struct.unpack(f">{len(data) // 2}H", data)
        return list(words[address - start : address - start + count])

    def _writing(self, operation: str, data: bytes, do: Callable[[bytes], None]) -> None:
        fault = self.faults.take(operation)
        if fault is None:
            do(data)
            return
        self._before(fault)
        kind = fault.kind
        if kind in ("lost_request", "restart", "hang"):
            return
        if kind == "lies":
            self._result = (struct.unpack_from(">H", data)[0], _DONE)
            return
        if kind == "bad_request":
            data = data[:-3] + bytes((data[-3] ^ 0x10,)) + data[-2:]
        self.memory.fail_amid = kind == "restart_amid"
        with contextlib.suppress(PowerFailsError):
            do(data)
        if kind == "twice":
            do(data)
        self._after(fault)

    def _before(self, fault: TableFault) -> None:
        if fault.kind == "refuses":
            raise RefusedRequestError(_DEVICE_FAILURE)
        if fault.kind in ("lost_request", "hang"):
            self.wire.answer = lambda _: ()
        if fault.kind == "hang":
            self.wire.silent_until = float("inf")
        if fault.kind == "restart":
            self._fail(fault)

    def _after(self, fault: TableFault) -> None:
        kind, seconds = fault.kind, fault.seconds
        if kind in ("lost_answer", "hang_after"):
            self.wire.answer = lambda _: ()
        if kind == "hang_after":
            self.wire.silent_until = float("inf")
        if kind == "late_answer":
            self.wire.answer = lambda data: ((seconds, data),)
        if kind == "twice":
            self.wire.answer = lambda data: ((0.0, data), (0.0, data))
        if kind == "bad_answer":
            self.wire.answer = lambda data: ((0.0, data[:-2] + bytes((data[-2] ^ 0x21, data[-1]))),)
        if kind in ("restart_after", "restart_amid"):
            self._fail(fault)

    def _fail(self, fault: TableFault) -> None:
        self.restart()
        self.wire.answer = lambda _: ()
        # the port stays taken: a gateway takes connections while the control behind it boots
        self.wire.drop = True
        self.wire.silent_until = time.monotonic() + fault.seconds

    # content

    def _identity(self, lies: bool) -> bytes:
        serial = SERIAL.replace("7", "8") if lies else SERIAL
        return NAME.encode().ljust(32, b"\0") + serial.encode().ljust(16, b"\0")

    def _state(self, lies: bool) -> bytes:
        memory = self.memory
        word = memory.idle | memory.referenced << 1 | self.protected << 2
        return struct.pack(">H", word ^ 3 if lies else word)

    def _status(self, lies: bool) -> bytes:
        memory = self.memory
        staged = memory.staged
        return _STATUS.pack(
            memory.session,
            len(staged),
            zlib.crc32(staged) if memory.whole else 0,
            len(memory.active),
            zlib.crc32(memory.active) ^ lies,
            *self._block,
            *self._result,
        )

    def _window(self, lies: bool) -> bytes:
        area, offset = self._pointer
        image = self.memory.active if area else self.memory.staged
        data = image[offset : offset + 2 * _WINDOW_WORDS - _WINDOW.size]
        if lies and data:
            middle = len(data) // 2
            data = data[:middle] + bytes((data[middle] ^ 0x01,)) + data[middle + 1 :]
        head = struct.pack(">HIH", area, offset, len(data))
        whole = _WINDOW.pack(area, offset, len(data), zlib.crc32(head + data)) + data
        return whole.ljust(2 * _WINDOW_WORDS, b"\0")

    def _shown(self, lies: bool) -> bytes:
        position, direction, correction = self.memory.step()
        data = struct.pack(">H", len(position))
        for axis, place in position.items():
            added = correction[axis] + (0.02 if lies else 0.0)
            data += struct.pack(">Hhdd", ord(axis), direction[axis], place, added)
        return data + struct.pack(">I", zlib.crc32(data))

    # effects of writing

    def _command(self, data: bytes) -> None:
        token, command, length, crc, check = _COMMAND.unpack(data)
        if zlib.crc32(data[:-2]) & 0xFFFF != check:
            self._result = (token, CHECKSUM)
            return
        memory = self.memory
        try:
            if self.protected and command in (2, 4):
                raise ControlRefusesError(NO)
            if command == 1:
                memory.begin(token, length, crc)
                self._block = (0, 0, 0)
            elif command == 2:
                memory.commit(length, crc)
            elif command == 3:
                memory.discard()
            elif command == 4:
                memory.deactivate()
        except ControlRefusesError as error:
            self._result = (token, error.code)
        else:
            self._result = (token, _DONE)

    def _put(self, data: bytes) -> None:
        session, sequence, offset, count, crc = _BLOCK.unpack_from(data)
        content = data[_BLOCK.size : _BLOCK.size + count]
        if zlib.crc32(data[:10] + content) != crc:
            return
        try:
            self.memory.put(session, offset, content)
        except ControlRefusesError:
            return
        self._block = (sequence, offset, zlib.crc32(content))
