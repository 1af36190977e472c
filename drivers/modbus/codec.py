"""Numbers in Modbus registers: types, byte and word orders, scaling; no I/O.

A register is 16 bits. A number of 32 or 64 bits lies in 2 or 4 consecutive registers, and Modbus
does not say in which order, so makers differ. Call the bytes of a 32-bit number A B C D, A the
most significant; the order names them as they stand in the registers, lowest address first:

====== ========================================== ============== ====================
order  meaning                                    32 bit         64 bit
====== ========================================== ============== ====================
ABCD   high word first, high byte first           ``AB CD``      ``AB CD EF GH``
CDAB   low word first, high byte first            ``CD AB``      ``GH EF CD AB``
BADC   high word first, bytes of a word swapped   ``BA DC``      ``BA DC FE HG``
DCBA   low word first, bytes of a word swapped    ``DC BA``      ``HG FE DC BA``
====== ========================================== ============== ====================

For 64 bits the two questions (word order, byte order within a word) stay the same two. A 16-bit
number has one word: ABCD and CDAB leave it, BADC and DCBA swap its bytes.

Values travel through Abbe as float64, which is exact for whole numbers up to
2⁵³ − 1 = 9 007 199 254 740 991. A 64-bit integer beyond that is refused in either direction, never
rounded in silence.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from math import isfinite
from operator import itemgetter
from typing import Literal

from abbe.drivers.scaled import UNSCALED, ScaledNumber

NumberType = Literal[
    "int16", "int32", "int64", "uint16", "uint32", "uint64", "float32", "float64", "bit"
]
Order = Literal["ABCD", "CDAB", "BADC", "DCBA"]
Raw = int | float
"""What a register field holds before scale and offset."""

EXACT_LIMIT = 2**53 - 1
"""Largest whole number that is told apart from its neighbours as a float64."""

_FORMATS: dict[NumberType, str] = {
    "int16": "h",
    "int32": "i",
    "int64": "q",
    "uint16": "H",
    "uint32": "I",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
    "bit": "H",
}
WORDS: dict[NumberType, int] = {t: struct.calcsize(">" + f) // 2 for t, f in _FORMATS.items()}
"""Registers that one number of each type takes ("bit": the register that the bit is in)."""

_FLOAT_LIMITS = {
    "float32": struct.unpack(">f", b"\x7f\x7f\xff\xff")[0],
    "float64": 1.7976931348623157e308,
}

Field = tuple[int, NumberType, Order]
"""One number in a run of registers: offset of its first register, type, order."""


class NotRepresentableError(ValueError):
    """A number that cannot be carried faithfully; the message says why and what is allowed."""


def raw_range(number_type: NumberType) -> tuple[Raw, Raw]:
    """Smallest and largest raw number that is carried faithfully, before scale and offset."""
    if number_type == "bit":
        return 0, 1
    if number_type in _FLOAT_LIMITS:
        return -_FLOAT_LIMITS[number_type], _FLOAT_LIMITS[number_type]
    bits = 16 * WORDS[number_type]
    low, high = (
        (0, 2**bits - 1)
        if number_type.startswith("u")
        else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    )
    return max(low, -EXACT_LIMIT), min(high, EXACT_LIMIT)


def wire_positions(number_type: NumberType, order: Order) -> tuple[int, ...]:
    """Where each byte of a number stands in its registers.

    Parameters
    ----------
    number_type, order
        As in the module's table.

    Returns
    -------
    tuple of int
        Element k is the byte index, within the number's registers as sent, of byte k of the number
        (k = 0 the most significant). The permutation is its own inverse.
    """
    words = WORDS[number_type]
    last_word_first = order in ("CDAB", "DCBA")
    low_byte_first = order in ("BADC", "DCBA")
    return tuple(
        2 * (words - 1 - word if last_word_first else word) + (byte ^ low_byte_first)
        for word in range(words)
        for byte in (0, 1)
    )


def compile_decoder(count: int, fields: Sequence[Field]) -> Callable[[bytes], tuple[Raw, ...]]:
    """Build a function that takes the bytes of `count` registers to the raw numbers of `fields`.

    Fields may overlap, leave gaps and stand in any order. Built once per request plan: one or two
    calls decode all numbers of an answer at once.

    Parameters
    ----------
    count
        Number of registers in the answer.
    fields
        Offset in the answer in registers, type and order of each number.
    """
    plain, end = ">", 0
    for at, typ, order in fields:
        if at < end or wire_positions(typ, order) != wire_positions(typ, "ABCD"):
            break
        plain += f"{2 * (at - end)}x{_FORMATS[typ]}"
        end = at + WORDS[typ]
    else:
        return struct.Struct(f"{plain}{2 * (count - end)}x").unpack
    gather = itemgetter(
        *(2 * at + k for at, typ, order in fields for k in wire_positions(typ, order))
    )
    unpack = struct.Struct(">" + "".join(_FORMATS[typ] for _, typ, _ in fields)).unpack
    return lambda data: unpack(bytes(gather(data)))


def compile_bit_decoder(offsets: Sequence[int]) -> Callable[[bytes], tuple[Raw, ...]]:
    """Build a function that picks bits out of the bytes of a coil or discrete-input answer.

    Parameters
    ----------
    offsets
        Position of each bit in the answer; bit 0 is the least significant of the first byte.
    """
    places = [(offset >> 3, offset & 7) for offset in offsets]
    return lambda data: tuple(data[byte] >> bit & 1 for byte, bit in places)


def compile_encoder(
    types: Sequence[tuple[NumberType, Order]],
) -> Callable[[Sequence[Raw]], tuple[int, ...]]:
    """Build a function that takes raw numbers to the registers that hold them, one after another.

    Parameters
    ----------
    types
        Type and order of each number; the first stands in the first register, none overlap.
    """
    pack = struct.Struct(">" + "".join(_FORMATS[typ] for typ, _ in types)).pack
    positions: list[int] = []
    for typ, order in types:
        start = len(positions)
        positions += [start + k for k in wire_positions(typ, order)]
    scatter = itemgetter(*positions)
    unpack = struct.Struct(f">{len(positions) // 2}H").unpack
    if positions == sorted(positions):
        return lambda numbers: unpack(pack(*numbers))
    return lambda numbers: unpack(bytes(scatter(pack(*numbers))))


def compile_reader(
    number_type: NumberType, bit: int = 0, scaled: ScaledNumber = UNSCALED
) -> Callable[[Raw], float]:
    """Build the function raw number → value.

    The function raises `NotRepresentableError` for NaN or infinity in a float and for an integer
    beyond ±(2⁵³ − 1). `bit` counts from 0, the least significant of the register.
    """
    if number_type == "bit":
        return lambda raw: float(int(raw) >> bit & 1)
    value_of = scaled.value_of
    if number_type in _FLOAT_LIMITS:

        def from_float(raw: Raw) -> float:
            value = value_of(raw)
            if not isfinite(value):
                raise NotRepresentableError(f"the device holds {raw}, not a finite number")
            return value

        return from_float
    if WORDS[number_type] == 4:

        def from_int64(raw: Raw) -> float:
            if not -EXACT_LIMIT <= raw <= EXACT_LIMIT:
                raise NotRepresentableError(
                    f"the device holds {raw}, which a float64 would round (limit ±{EXACT_LIMIT})"
                )
            return value_of(raw)

        return from_int64
    return value_of if scaled.scaling else float


def compile_readers(
    kinds: Sequence[tuple[NumberType, int, ScaledNumber]],
) -> Callable[[Sequence[Raw]], list[float]]:
    """Build the function raw numbers → values of several channels; raises as `compile_reader`'s.

    Parameters
    ----------
    kinds
        Type, bit and scale of each.
    """
    if all(kind != "bit" and kind not in _FLOAT_LIMITS and WORDS[kind] < 4 for kind, _, _ in kinds):
        # whole numbers that every float64 holds: nothing to be checked
        return ScaledNumber.values_of([scaled for _, _, scaled in kinds])
    readers = tuple(compile_reader(kind, bit=bit, scaled=scaled) for kind, bit, scaled in kinds)
    return lambda numbers: [read(raw) for read, raw in zip(readers, numbers, strict=True)]


def compile_writer(
    number_type: NumberType, *, scaled: ScaledNumber = UNSCALED
) -> Callable[[float], Raw]:
    """Build the function value → raw number, to the nearest count for integers.

    The function raises `NotRepresentableError` for NaN, infinity, or a value that the type does
    not hold, and names the range in the channel's own unit.
    """
    if number_type == "bit":
        return _bit_to_raw
    low, high = raw_range(number_type)
    whole = number_type not in _FLOAT_LIMITS
    ends, number_of = scaled.range_of(low, high), scaled.number_of

    def to_raw(value: float) -> Raw:
        number = number_of(value)
        if low <= number <= high:
            return round(number) if whole else number
        if not isfinite(number):
            raise NotRepresentableError(f"{value} is not a finite number")
        raw: Raw = round(number) if whole else number
        if not low <= raw <= high:
            raise NotRepresentableError(
                f"{value!r} does not fit {number_type}: allowed {ends[0]!r} to {ends[1]!r}"
            )
        return raw

    return to_raw


def _bit_to_raw(value: float) -> Raw:
    if value not in (0.0, 1.0):
        raise NotRepresentableError(f"{value!r} is not a bit: allowed 0 and 1")
    return int(value)
