"""An image as blocks of a tape: each with its number and its own checksum, printable ASCII only.

``N00001 <45 bytes as base64> <CRC-32 of number and bytes>``: a lost, doubled or altered block is
seen, and none can shift the bytes behind it.
"""

from __future__ import annotations

import base64
import binascii
import re
import zlib
from collections.abc import Sequence

from abbe.drivers.link import LinkProtocolError

BYTES = 45
"""Of the image in a block: 60 characters."""
_BLOCK = re.compile(r"N(\d{5}) ([A-Za-z0-9+/=]+) ([0-9A-F]{8})")


def to_blocks(image: bytes) -> list[str]:
    """Blocks of an image, numbered from 1."""
    return [
        f"N{number:05d} {base64.b64encode(part).decode()} {_crc(number, part):08X}"
        for number, part in enumerate(
            (image[at : at + BYTES] for at in range(0, len(image), BYTES)), start=1
        )
    ]


def from_blocks(blocks: Sequence[str]) -> bytes:
    """The image that blocks hold.

    Raises
    ------
    LinkProtocolError
        For a block that is missing, out of order or altered.
    """
    image = b""
    for number, block in enumerate(blocks, start=1):
        match = _BLOCK.fullmatch(block)
        try:
            part = base64.b64decode(match[2], validate=True) if match else b""
        except binascii.Error:
            part = b""
        if match is None or not part:
            raise LinkProtocolError(f"block {number} of the tape is altered")
        if int(match[1]) != number:
            raise LinkProtocolError(f"block {number} of the tape calls itself {int(match[1])}")
        if _crc(number, part) != int(match[3], 16):
            raise LinkProtocolError(f"block {number} of the tape has a wrong checksum")
        image += part
    return image


def _crc(number: int, part: bytes) -> int:
    return zlib.crc32(f"N{number:05d} ".encode("ascii") + part)
