"""Values of a CANopen object dictionary: data types of CiA 301 (7.1.6), little-endian."""

from __future__ import annotations

import math
import struct
from typing import Literal

Type = Literal[
    "bool",
    "int8",
    "int16",
    "int32",
    "int64",
    "uint8",
    "uint16",
    "uint32",
    "uint64",
    "float32",
    "float64",
]

_FORMATS: dict[str, struct.Struct] = {
    "bool": struct.Struct("<B"),
    "int8": struct.Struct("<b"),
    "int16": struct.Struct("<h"),
    "int32": struct.Struct("<l"),
    "int64": struct.Struct("<q"),
    "uint8": struct.Struct("<B"),
    "uint16": struct.Struct("<H"),
    "uint32": struct.Struct("<L"),
    "uint64": struct.Struct("<Q"),
    "float32": struct.Struct("<f"),
    "float64": struct.Struct("<d"),
}
_LARGEST_FLOAT32 = (2.0 - 2.0**-23) * 2.0**127
_EXACT = 1 << 53
"""Whole numbers up to here are exact in a 64-bit float."""


def size_of(kind: Type) -> int:
    """Bytes that a type takes."""
    return _FORMATS[kind].size


def range_of(kind: Type) -> tuple[float, float, float]:
    """Smallest and largest number of a type that a 64-bit float holds exactly, and its step.

    >>> range_of("int16")
    (-32768.0, 32767.0, 1.0)
    """
    if kind.startswith("float"):
        largest = _LARGEST_FLOAT32 if kind == "float32" else math.inf
        return -largest, largest, 0.0
    if kind == "bool":
        return 0.0, 1.0, 1.0
    bits = 8 * size_of(kind)
    signed = not kind.startswith("u")
    low = -(1 << bits - 1) if signed else 0
    high = (1 << bits - signed) - 1
    return float(max(low, 1 - _EXACT)), float(min(high, _EXACT - 1)), 1.0


def decode(kind: Type, data: bytes) -> float:
    """The number in an object's bytes.

    Raises
    ------
    ValueError
        When there are more or fewer bytes than the type has, or a 64-bit float cannot hold it.

    >>> decode("int32", bytes([0xC7, 0xCF, 0xFF, 0xFF]))
    -12345.0
    """
    form = _FORMATS[kind]
    if len(data) != form.size:
        raise ValueError(f"{len(data)} bytes came, {kind} has {form.size}")
    (number,) = form.unpack(data)
    if isinstance(number, int) and abs(number) >= _EXACT:
        raise ValueError(f"the device holds {number}, which a 64-bit float cannot hold exactly")
    value = float(number)
    if value - value != 0.0:
        raise ValueError(f"the device holds {value}")
    return value


def encode(kind: Type, value: float) -> bytes:
    """The bytes of a number; whole types take the nearest one.

    Raises
    ------
    ValueError
        When it does not fit.
    """
    if value - value != 0.0:
        raise ValueError(f"{value} cannot be sent")
    number = value if kind.startswith("float") else round(value)
    if kind == "bool" and number not in (0, 1):
        raise ValueError(f"{number} is no bool")
    try:
        return _FORMATS[kind].pack(number)
    except (struct.error, OverflowError):
        raise ValueError(f"{number} does not fit {kind}") from None
