"""Checksums of ASCII lines: what they cover, how they are computed, how they are written.

Sources: NMEA 0183 (exclusive or between ``$`` and ``*``, two hexadecimal digits); Modbus ASCII
(MODBUS over Serial Line V1.02, 2.5.2.2: LRC, the two's complement of the sum) and RTU (2.5.1.2:
CRC-16); ISO 1155/1745 (BCC, exclusive or behind STX up to and with ETX). CRC parameters as in
Williams, "A painless guide to CRC error detection algorithms" (1993); check values are those of
the nine bytes ``123456789``.
"""

from __future__ import annotations

import binascii
import functools
import operator
from collections.abc import Callable, Mapping
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Kind = Literal["sum", "sum16", "xor", "lrc", "crc16", "crc16-arc", "crc16-ccitt", "crc16-xmodem"]
Form = Literal["hex", "binary", "binary-low-first"]


def _reflected_crc(data: bytes, start: int) -> int:
    """CRC-16 of the polynomial 8005h, least significant bit first."""
    crc = start
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
    return crc


ALGORITHMS: Mapping[Kind, Callable[[bytes], int]] = {
    "sum": lambda data: sum(data) & 0xFF,
    "sum16": lambda data: sum(data) & 0xFFFF,
    "xor": lambda data: functools.reduce(operator.xor, data, 0),
    "lrc": lambda data: -sum(data) & 0xFF,
    "crc16": lambda data: _reflected_crc(data, 0xFFFF),
    "crc16-arc": lambda data: _reflected_crc(data, 0),
    "crc16-ccitt": lambda data: binascii.crc_hqx(data, 0xFFFF),
    "crc16-xmodem": lambda data: binascii.crc_hqx(data, 0),
}
"""Kind → its computation. ``crc16`` is Modbus's (check value 4B37h), ``-arc`` BB3Dh, ``-ccitt``
29B1h, ``-xmodem`` 31C3h."""

_BYTES: Mapping[Kind, int] = {"sum": 1, "xor": 1, "lrc": 1}


class ChecksumError(ValueError):
    """A line's checksum is missing or wrong."""


class ChecksumConfig(BaseModel):
    """Where a line carries its checksum."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    kind: Kind
    form: Form = "hex"
    """As two or four hexadecimal digits, or as bytes."""
    after: str = ""
    """What stands between the covered text and the checksum, e.g. ``*``."""
    covers_after: bool = False
    """Whether `after` is covered too (BCC: ETX is)."""
    skip: Annotated[int, Field(ge=0)] = 0
    """Characters at the beginning that are not covered (1 for ``$`` or STX)."""
    queries: bool = True
    """Whether queries carry one too."""

    @property
    def width(self) -> int:
        """Characters that the checksum itself takes."""
        size = _BYTES.get(self.kind, 2)
        return 2 * size if self.form == "hex" else size

    def compute(self, line: bytes) -> bytes:
        """The checksum of a line without one, as it is written."""
        covered = line[self.skip :]
        if self.covers_after:
            covered += self.after.encode("latin-1")
        value = ALGORITHMS[self.kind](covered)
        if self.form == "hex":
            return b"%0*X" % (self.width, value)
        return value.to_bytes(self.width, "little" if self.form == "binary-low-first" else "big")

    def add(self, line: bytes) -> bytes:
        """A line with its checksum."""
        return line + self.after.encode("latin-1") + self.compute(line)

    def take(self, line: bytes) -> bytes:
        """A received line without its checksum.

        Raises
        ------
        ChecksumError
            When it is missing or wrong; says what was found and computed.
        """
        after = self.after.encode("latin-1")
        end = len(line) - self.width
        body = line[: max(0, end - len(after))]
        if end < len(after) or line[len(body) : end] != after:
            raise ChecksumError(f"no checksum in {shown(line)}")
        found, computed = line[end:], self.compute(body)
        same = found.upper() == computed if self.form == "hex" else found == computed
        if not same:
            raise ChecksumError(
                f"checksum {shown(found)} in {shown(line)}, computed {shown(computed)}"
            )
        return body


def shown(data: bytes) -> str:
    """Bytes of a line for people, in quotes, what is not printable escaped."""
    text = data if len(data) <= 60 else data[:57] + b"..."
    return "'" + ascii(text.decode("latin-1"))[1:-1] + "'"
