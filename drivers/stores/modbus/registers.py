"""The register map of a controller's table memory over Modbus: what stands where, how packed.

The map's shape is Abbe's; a controller's programmer provides it, ``docs/upload.md`` shows it. Where
it stands is configuration. All numbers are big-endian, the high word first.
"""

from __future__ import annotations

import struct
import zlib
from typing import Annotated, NamedTuple

from pydantic import Field

from abbe.drivers.link import LinkProtocolError
from abbe.drivers.stores.base import ShownCorrection, StoreConfig

Address = Annotated[int, Field(ge=0, le=65535)]
Bit = Annotated[int, Field(ge=0, le=15)]

BEGIN, COMMIT, DISCARD, DEACTIVATE = 1, 2, 3, 4
DONE = 1
RESULTS = {
    2: "the machine is not idle or not referenced",
    3: "nothing whole is staged",
    4: "a checksum is wrong",
    5: "the tables do not fit in its memory",
    6: "it does not understand the tables",
    7: "another upload is under way",
    8: "its memory is protected",
}
"""Why a command was not carried out."""


class RegisterMap(StoreConfig):
    """Addresses, counted from 0 as sent; all in the holding registers."""

    identity: Address = 0
    """Name and serial number, ASCII, two characters a register, filled up with zeros."""
    name_words: Annotated[int, Field(ge=1, le=60)] = 16
    serial_words: Annotated[int, Field(ge=0, le=60)] = 8
    state: Address = 24
    """State word."""
    idle_bit: Bit = 0
    """1: no programme runs and no axis moves."""
    referenced_bit: Bit = 1
    protected_bit: Bit | None = 2
    """1: the memory is write-protected (a key switch); none: there is no such bit."""
    status: Address = 32
    """18 registers, `Status`."""
    command: Address = 64
    """7 registers: token, command, length, CRC-32, check."""
    block: Address = 128
    """7 registers and the bytes: session, sequence, offset, bytes, CRC-32."""
    block_words: Annotated[int, Field(ge=8, le=123)] = 123
    """Registers that one write may have."""
    pointer: Address = 256
    """3 registers: area (0 staged, 1 active) and offset of what the window shows."""
    window: Address = 260
    """6 registers and the bytes: area, offset, bytes, CRC-32."""
    window_words: Annotated[int, Field(ge=7, le=125)] = 125
    shown: Address | None = 400
    """Positions and corrections as they are now; none: the controller shows none."""
    axes: Annotated[int, Field(ge=1, le=12)] = 3
    """How many axes are shown."""


class MemoryStatus(NamedTuple):
    """The status of a table memory: what it holds.

    Attributes
    ----------
    session
        Token of the command that began the staging area; 0: none.
    staged_length, staged_crc
        Bytes and CRC-32 of what is staged; CRC 0 while it is not whole.
    active_length, active_crc
        The same of what is active; 0: nothing.
    sequence, offset, block_crc
        The last block that was stored.
    token, result
        The last command and what became of it: 0 not finished, 1 done, else `RESULTS`.
    """

    session: int
    staged_length: int
    staged_crc: int
    active_length: int
    active_crc: int
    sequence: int
    offset: int
    block_crc: int
    token: int
    result: int


_STATUS = struct.Struct(">HIIIIHIIHH6x")
STATUS_WORDS = _STATUS.size // 2
_COMMAND = struct.Struct(">HHII")
_BLOCK = struct.Struct(">HHIH")
_WINDOW = struct.Struct(">HIHI")
_AXIS = struct.Struct(">Hhdd")


def words_of(data: bytes) -> tuple[int, ...]:
    """Registers that hold bytes, filled up with a zero."""
    even = data + b"\0" * (len(data) % 2)
    return struct.unpack(f">{len(even) // 2}H", even)


def status_of(data: bytes) -> MemoryStatus:
    """The status registers."""
    return MemoryStatus(*_STATUS.unpack(data))


def text_of(data: bytes) -> str:
    """Characters in registers.

    Raises
    ------
    LinkProtocolError
        When they are none.
    """
    try:
        text = data.rstrip(b"\0 ").decode("ascii")
    except UnicodeDecodeError:
        raise LinkProtocolError(f"{data!r} is no text") from None
    if not text.isprintable():
        raise LinkProtocolError(f"{data!r} is no text")
    return text


def command(token: int, what: int, length: int = 0, crc: int = 0) -> tuple[int, ...]:
    """Registers of a command."""
    data = _COMMAND.pack(token, what, length, crc)
    return words_of(data + struct.pack(">H", zlib.crc32(data) & 0xFFFF))


def block(session: int, sequence: int, offset: int, content: bytes) -> tuple[int, ...]:
    """Registers of a block; session, sequence and offset are covered by its checksum."""
    head = _BLOCK.pack(session, sequence, offset, len(content))
    return words_of(head + struct.pack(">I", zlib.crc32(head + content)) + content)


def block_bytes(words: int) -> int:
    """Bytes of content in a block of so many registers."""
    return 2 * words - _BLOCK.size - 4


def pointer(area: int, offset: int) -> tuple[int, ...]:
    """Registers of the pointer."""
    return words_of(struct.pack(">HI", area, offset))


def window(data: bytes, area: int, offset: int) -> bytes:
    """The bytes that a window shows.

    Raises
    ------
    LinkProtocolError
        When it shows another place, or its checksum is wrong.
    """
    found_area, found_offset, count, crc = _WINDOW.unpack_from(data)
    content = data[_WINDOW.size : _WINDOW.size + count]
    head = struct.pack(">HIH", found_area, found_offset, count)
    if len(content) != count or zlib.crc32(head + content) != crc:
        raise LinkProtocolError("the window's checksum is wrong")
    if (found_area, found_offset) != (area, offset):
        raise LinkProtocolError(
            f"the window shows area {found_area} from byte {found_offset}, "
            f"asked was area {area} from byte {offset}"
        )
    return content


def shown_words(axes: int) -> int:
    """Registers that show so many axes."""
    return 1 + axes * _AXIS.size // 2 + 2


def shown(data: bytes) -> ShownCorrection:
    """Positions and corrections of all axes at one moment.

    Raises
    ------
    LinkProtocolError
        When the checksum is wrong, or a number is none.
    """
    body, (crc,) = data[:-4], struct.unpack(">I", data[-4:])
    if zlib.crc32(body) != crc:
        raise LinkProtocolError("the checksum of the shown corrections is wrong")
    position, direction, correction = {}, {}, {}
    for letter, way, place, added in _AXIS.iter_unpack(body[2:]):
        axis = chr(letter)
        if place != place or added != added or not axis.isalpha():
            raise LinkProtocolError(f"axis {axis!r}: position {place}, correction {added}")
        position[axis], direction[axis], correction[axis] = place, way, added
    return ShownCorrection(position, correction, direction)
