"""Fields of messages: from a field's text to a channel's value."""

from __future__ import annotations

import re
from collections.abc import Callable

from abbe.drivers.serial.config import SerialChannelConfig

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_HEX = re.compile(r"[0-9A-Fa-f]+", re.ASCII)


class FieldError(ValueError):
    """A field's text is not what its channel expects."""


def compile_reader(channel: SerialChannelConfig) -> Callable[[str | None], float]:
    """How a field's text (None where the pattern left it out) becomes the channel's value.

    Blanks do not count, so that ``+ 12.345`` is a number. The function raises `FieldError`.

    >>> read = compile_reader(SerialChannelConfig(message="m", scale=0.001))
    >>> read("- 1234")
    -1.234
    """
    value_of = channel.value_of
    if channel.values is not None:
        table = channel.values

        def look_up(text: str | None) -> float:
            try:
                return value_of(table[(text or "").strip()])
            except KeyError:
                raise FieldError(f"found {text!r}, expected one of {', '.join(table)}") from None

        return look_up
    if channel.base == 16:
        bits = channel.bits

        def read_hex(text: str | None) -> float:
            digits = "" if text is None else text.replace(" ", "")
            if not _HEX.fullmatch(digits):
                raise FieldError(f"found {text!r}, expected hexadecimal digits")
            number = int(digits, 16)
            if bits is not None:
                if number >> bits:
                    raise FieldError(f"found {text!r}, which has more than {bits} bits")
                if number >> (bits - 1):
                    number -= 1 << bits
            if abs(number) > 1 << 53:
                raise FieldError(f"found {text!r}, which a 64-bit float cannot hold exactly")
            return value_of(number)

        return read_hex
    comma = channel.decimal == ","
    is_number = _NUMBER.fullmatch

    def read_decimal(text: str | None) -> float:
        number = text or ""
        if " " in number:
            number = number.replace(" ", "")
        if comma:
            number = number.replace(".", "!").replace(",", ".")
        if not is_number(number):
            raise FieldError(f"found {text!r}, expected a number")
        value = value_of(float(number))
        if value - value != 0.0:
            raise FieldError(f"found {text!r}, too large for a 64-bit float")
        return value

    return read_decimal
