"""Frames of the request in flight: which bytes answer it, stricter than pymodbus is.

`abbe.drivers.modbus.bus.client` says what pymodbus does by itself; no third file of the drivers
imports it.
"""

from __future__ import annotations

import struct

from pymodbus.exceptions import ModbusIOException
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.register_message import WriteMultipleRegistersRequest

_HEADER = struct.Struct(">HHHB")
"""Transaction, protocol 0, bytes that follow (unit included), unit: MODBUS Messaging on TCP/IP
Implementation Guide V1.0b, 3.1.3."""


class Answer(ModbusPDU):
    """The answer to a read, kept as bytes, where pymodbus makes a list of numbers of it."""

    rtu_byte_count_pos = 2
    payload = b""

    def decode(self, data: bytes) -> None:
        """Take the bytes behind the byte count; none where the two differ."""
        self.payload = data[1:] if data[0] == len(data) - 1 else b""


class _CoilAnswer(Answer):
    function_code = 1


class _DiscreteAnswer(Answer):
    function_code = 2


class _HoldingAnswer(Answer):
    function_code = 3


class _InputAnswer(Answer):
    function_code = 4


class StrictRtuFramer(FramerRTU):
    """Finds the one frame that can answer the request in flight, and is deaf to all others.

    A Modbus RTU frame does not say which request it answers. What it does say is compared here:
    unit, function, and the number of bytes (of a read) or the address and the count (of a write).
    The frame is found behind and between foreign bytes, too.
    """

    MAX_SIZE = 1024
    """Bytes kept: a foreign frame (256) in front of the answer must not push it out."""

    def __init__(self, decoder: DecodePDU) -> None:
        super().__init__(decoder)
        self._wanted: tuple[tuple[bytes, int], ...] = ()

    def expect(self, unit: int, answer: bytes, size: int) -> None:
        """Name the answer: how it begins (function code first), its size without unit and CRC."""
        refusal = bytes((unit, answer[0] | 0x80))
        self._wanted = ((bytes((unit,)) + answer, size + 1), (refusal, 3))

    def decode(self, data: bytes) -> tuple[int, int, int, bytes]:
        """Bytes used, unit, 0, and the frame without unit and CRC; all 0 and empty: not yet."""
        for head, size in self._wanted:
            at = data.find(head)
            while at >= 0 and at + size + 2 <= len(data):
                end = at + size
                if self.check_CRC(data[at:end], int.from_bytes(data[end : end + 2], "big")):
                    return end + 2, head[0], 0, data[at + 1 : end]
                at = data.find(head, at + 1)
        return 0, 0, 0, self.EMPTY


class Confirmed(Answer):
    """An answer that is the expected one to its last byte but for `payload`.

    Made without ``__init__``: nothing else of it is asked for.
    """

    def __init__(self, payload: bytes) -> None:
        self.payload = payload


class RegistersRequest(WriteMultipleRegistersRequest):
    """A write of registers, packed at once, where pymodbus packs them one by one."""

    def encode(self) -> bytes:
        """Address, count, byte count, registers."""
        words = self.registers
        count = len(words)
        return struct.pack(f">HHB{count}H", self.address, count, 2 * count, *words)


class StrictTcpFramer(FramerSocket):
    """Refuses transaction id 0, which pymodbus takes for the answer to anything.

    An answer that is as expected is recognised by its first bytes, all of which are known
    beforehand; everything else takes pymodbus's way.
    """

    def __init__(self, decoder: DecodePDU) -> None:
        super().__init__(decoder)
        self._wanted, self._size = b"", -1

    def expect(self, transaction: int, unit: int, answer: bytes, size: int) -> None:
        """Name the answer: how it begins (function code first), its size without the header."""
        self._wanted = _HEADER.pack(transaction, 0, size + 1, unit) + answer
        self._size = size + _HEADER.size

    def expected(self, data: bytes) -> Confirmed | None:
        """The answer, where `data` is all of it and nothing else; else None."""
        if len(data) == self._size and data.startswith(self._wanted):
            return Confirmed(data[len(self._wanted) :])
        return None

    def decode(self, data: bytes) -> tuple[int, int, int, bytes]:
        """As the base class, with transaction id −1, which no request has, in place of 0."""
        used, unit, transaction, frame = super().decode(data)
        return used, unit, transaction or -1, frame

    def handleFrame(
        self, data: bytes, exp_devid: int, exp_tid: int
    ) -> tuple[int, ModbusPDU | None]:
        """As the base class, but an undecodable answer is no answer and no error in asyncio."""
        if (answer := self.expected(data)) is not None:
            return self._size, answer
        try:
            return super().handleFrame(data, exp_devid, exp_tid)
        except ModbusIOException:
            return len(data), None


def decoder() -> DecodePDU:
    """What makes answers of frames: those to reads keep their bytes."""
    made = DecodePDU(False)
    for answer in (_CoilAnswer, _DiscreteAnswer, _HoldingAnswer, _InputAnswer):
        made.register(answer)
    return made
