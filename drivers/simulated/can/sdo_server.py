"""The server side of CANopen's SDO: expedited, segmented and block transfers (CiA 301, 7.2.4.3).

Written from the specification, without the canopen package, so that the two check each other.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

TOGGLE_NOT_ALTERNATED = 0x05030000
UNKNOWN_COMMAND = 0x05040001
CRC_ERROR = 0x05040004
READ_ONLY = 0x06010002
NO_OBJECT = 0x06020000
WRONG_LENGTH = 0x06070010

Key = tuple[int, int]


class AbortCodeError(Exception):
    """A value is not taken; carries the abort code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"{code:#010x}")
        self.code = code


@dataclass
class Entry:
    """One object: how it is read, and written where it can be."""

    get: Callable[[], bytes]
    put: Callable[[bytes], None] | None = None


@dataclass
class BlockFaults:
    """What goes wrong with block downloads.

    Attributes
    ----------
    lose
        Numbers (from 1, over the whole transfer) of segments that do not arrive.
    hang_after
        Nothing is answered any more after so many segments.
    spoil
        One bit of the data is flipped: the checksum differs.
    refused
        Block transfer is not supported at all.
    """

    lose: set[int] = field(default_factory=set)
    hang_after: int | None = None
    spoil: bool = False
    refused: bool = False


def _crc_of_byte(byte: int) -> int:
    crc = byte << 8
    for _ in range(8):
        crc = ((crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


_CRC_OF = [_crc_of_byte(byte) for byte in range(256)]


def crc16(data: bytes | bytearray) -> int:
    """CRC-16-CCITT as in CiA 301, 7.2.4.3.16: polynomial 1021h, begun with 0."""
    crc = 0
    for byte in data:
        crc = (crc << 8) & 0xFFFF ^ _CRC_OF[crc >> 8 ^ byte]
    return crc


class SdoServer:
    """One node's default SDO.

    Parameters
    ----------
    objects
        Index and subindex → what is there.
    block_size
        Segments that it takes in one block.
    """

    def __init__(self, objects: dict[Key, Entry], block_size: int = 32) -> None:
        self._objects = objects
        self._block_size = block_size
        self.faults = BlockFaults()
        self._key: Key = (0, 0)
        self._data = bytearray()
        self._toggle = 0
        self._state = "idle"
        self._segments = 0
        self._sequence = 0
        self._last = False
        self._burst: list[bytes] = []
        self._taken = self._upload_size = 0

    @property
    def amid_block(self) -> bool:
        """Whether the next frame is a segment of a block download."""
        return self._state == "block"

    def forget(self) -> None:
        """Give up the transfer under way."""
        self._state = "idle"

    def answers(self, request: bytes) -> list[bytes]:
        """The answers to one frame: none, one, or the segments of a block."""
        self._burst = []
        answer = self.answer(request)
        return self._burst if answer is None else [answer]

    def answer(self, request: bytes) -> bytes | None:
        """The answer to one frame; None where there is none."""
        if len(request) != 8:
            return None
        try:
            return self._answer(request)
        except AbortCodeError as error:
            self._state = "idle"
            return struct.pack("<BHBL", 0x80, *self._key, error.code)

    def _answer(self, request: bytes) -> bytes | None:
        if self._state == "block":
            return self._block_segment(request)
        command = request[0] >> 5
        if command == 4:  # the client aborts
            self._state = "idle"
            return None
        initiates = (command == 6 and not request[0] & 1) or (command == 5 and not request[0] & 3)
        if command in (1, 2) or initiates:
            self._key = struct.unpack_from("<HB", request, 1)
        if command == 2:
            return self._begin_upload()
        if command == 3:
            return self._upload_segment(request[0])
        if command == 1:
            return self._begin_download(request)
        if command == 0:
            return self._download_segment(request)
        if command == 6:
            return self._end_block(request) if request[0] & 1 else self._begin_block(request)
        if command == 5:
            return self._block_upload(request)
        raise AbortCodeError(UNKNOWN_COMMAND)

    def _block_upload(self, request: bytes) -> bytes | None:
        """Initiate, start, confirmation of a block, end (CiA 301, 7.2.4.3.9 to 7.2.4.3.11)."""
        what = request[0] & 3
        if what == 0:
            if self.faults.refused:
                raise AbortCodeError(UNKNOWN_COMMAND)
            self._data = bytearray(self._entry().get())
            self._taken, self._upload_size = 0, request[4]
            self._state = "block upload"
            return struct.pack("<BHBL", 0xC6, *self._key, len(self._data))
        if self._state != "block upload":
            raise AbortCodeError(UNKNOWN_COMMAND)
        if what == 1:
            self._state = "idle"
            return None
        if what == 2:
            self._taken = min(self._taken + 7 * request[1], len(self._data))
            self._upload_size = request[2]
            if self._taken == len(self._data):
                unused = -len(self._data) % 7
                return struct.pack("<BH5x", 0xC1 | unused << 2, crc16(self._data))
        rest = self._data[self._taken : self._taken + 7 * self._upload_size]
        for sequence, start in enumerate(range(0, len(rest), 7), start=1):
            last = self._taken + start + 7 >= len(self._data)
            piece = bytes(rest[start : start + 7]).ljust(7, b"\0")
            self._burst.append(bytes((sequence | 0x80 * last,)) + piece)
        return None

    def _entry(self) -> Entry:
        entry = self._objects.get(self._key)
        if entry is None:
            raise AbortCodeError(NO_OBJECT)
        return entry

    def _begin_upload(self) -> bytes:
        data = self._entry().get()
        if 0 < len(data) <= 4:
            command = 0x43 | (4 - len(data)) << 2
            return struct.pack("<BHB", command, *self._key) + data.ljust(4, b"\0")
        self._data, self._toggle, self._state = bytearray(data), 0, "upload"
        return struct.pack("<BHBL", 0x41, *self._key, len(data))

    def _upload_segment(self, command: int) -> bytes:
        if self._state != "upload":
            raise AbortCodeError(UNKNOWN_COMMAND)
        if command & 0x10 != self._toggle:
            raise AbortCodeError(TOGGLE_NOT_ALTERNATED)
        piece = bytes(self._data[:7])
        del self._data[:7]
        head = self._toggle | (7 - len(piece)) << 1 | (not self._data)
        self._toggle ^= 0x10
        if not self._data:
            self._state = "idle"
        return bytes((head,)) + piece.ljust(7, b"\0")

    def _writable(self) -> Callable[[bytes], None]:
        put = self._entry().put
        if put is None:
            raise AbortCodeError(READ_ONLY)
        return put

    def _begin_download(self, request: bytes) -> bytes:
        put = self._writable()
        if request[0] & 2:
            size = 4 - (request[0] >> 2 & 3) if request[0] & 1 else 4
            put(request[4 : 4 + size])
        else:
            self._data, self._toggle, self._state = bytearray(), 0, "download"
        return struct.pack("<BHBL", 0x60, *self._key, 0)

    def _download_segment(self, request: bytes) -> bytes:
        if self._state != "download":
            raise AbortCodeError(UNKNOWN_COMMAND)
        if request[0] & 0x10 != self._toggle:
            raise AbortCodeError(TOGGLE_NOT_ALTERNATED)
        self._data += request[1 : 8 - (request[0] >> 1 & 7)]
        answer = 0x20 | self._toggle
        self._toggle ^= 0x10
        if request[0] & 1:
            self._state = "idle"
            self._writable()(bytes(self._data))
        return bytes((answer,)) + bytes(7)

    def _begin_block(self, request: bytes) -> bytes:
        if self.faults.refused:
            raise AbortCodeError(UNKNOWN_COMMAND)
        self._writable()
        self._data, self._state = bytearray(), "block"
        self._segments = self._sequence = 0
        self._last = False
        return struct.pack("<BHBB3x", 0xA4, *self._key, self._block_size)

    def _block_segment(self, request: bytes) -> bytes | None:
        """Take in a segment; a block's end is confirmed with what came in sequence."""
        if request[0] == 0x80:
            self._state = "idle"
            return None
        faults = self.faults
        self._segments += 1
        if faults.hang_after is not None and self._segments > faults.hang_after:
            return None
        if self._segments in faults.lose:
            return None
        sequence, last = request[0] & 0x7F, bool(request[0] & 0x80)
        if sequence == self._sequence + 1:
            self._sequence = sequence
            self._data += request[1:]
            self._last = last
        if not last and sequence < self._block_size:
            return None
        got, self._sequence = self._sequence, 0
        if self._last:
            self._state = "ending"
        return bytes((0xA2, got, self._block_size)) + bytes(5)

    def _end_block(self, request: bytes) -> bytes:
        if self._state != "ending":
            raise AbortCodeError(UNKNOWN_COMMAND)
        unused = request[0] >> 2 & 7
        data = bytes(self._data[: len(self._data) - unused])
        if self.faults.spoil:
            data = bytes((data[0] ^ 1,)) + data[1:]
        (stated,) = struct.unpack_from("<H", request, 1)
        if crc16(data) != stated:
            raise AbortCodeError(CRC_ERROR)
        self._state = "idle"
        self._writable()(data)
        return bytes((0xA1,)) + bytes(7)
