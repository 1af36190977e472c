"""The DBC file: messages and signals that a link uses; the only user of cantools."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from abbe.drivers.can.dbc.config import DbcChannelConfig, DbcConfig
from abbe.drivers.link import LinkConfigError

if TYPE_CHECKING:
    from cantools.database.can import Message, Signal

MOST_BYTES = 16_000_000
"""Of the file; cantools needs a minute for that many."""
_LONGEST = 300
"""Characters of a parser's complaint."""
MISSING_AFTER = 3.0
"""Cycle times without a message after which it is missing."""
_LEAST_WITHIN, _DEFAULT_WITHIN = 0.1, 1.0


def load(config: DbcConfig) -> dict[str, Message]:
    """Messages that the link's channels need, by name.

    Raises
    ------
    LinkConfigError
        When the file cannot be read, or lacks a message or signal (says what it has), or two of
        the messages cannot be told apart, or are CAN FD on a link that is not.
    """
    import cantools

    if not Path(config.dbc).is_file():
        raise LinkConfigError(f"there is no file {config.dbc}", ("dbc",))
    try:
        if Path(config.dbc).stat().st_size > MOST_BYTES:
            raise ValueError(f"it is larger than {MOST_BYTES / 1e6:g} MB")
        database = cantools.database.load_file(config.dbc)
    except Exception as error:
        # cantools raises its parsers' errors as they are
        raise LinkConfigError(
            f"{config.dbc} cannot be read: {_one_line(error)}", ("dbc",)
        ) from error
    found: dict[str, Message] = {}
    for name, channel in config.channels.items():
        key = ("channels", name)
        message = _message(database, channel.message, config.dbc, (*key, "message"))
        signal_of(message, name, channel)
        found[channel.message] = message
    for name in config.messages:
        _message(database, name, config.dbc, ("messages", name))
        if name not in found:
            raise LinkConfigError(f"message {name} is used by no channel", ("messages", name))
    _check_frames(list(found.values()), config)
    return found


def _one_line(error: Exception) -> str:
    """A parser's complaint in one line: it may quote a line of any length."""
    words = " ".join(str(error).split()) or type(error).__name__
    return words if len(words) <= _LONGEST else words[:_LONGEST] + " …"


def _message(database: Any, name: str, file: str, key: tuple[str, ...]) -> Message:
    for message in database.messages:
        if message.name == name:
            found: Message = message
            return found
    raise LinkConfigError(
        f"{file} has no message {name!r}; it has: "
        + ", ".join(message.name for message in database.messages),
        key,
    )


def _check_frames(messages: Sequence[Message], config: DbcConfig) -> None:
    taken: dict[tuple[int, bool], str] = {}
    for message in messages:
        number = (message.frame_id, message.is_extended_frame)
        if number in taken:
            raise LinkConfigError(
                f"messages {taken[number]} and {message.name} have the same id "
                f"{message.frame_id:X}h in {config.dbc}: nobody can tell their frames apart",
                ("dbc",),
            )
        taken[number] = message.name
        if message.is_fd and config.options.get("fd") is not True:
            raise LinkConfigError(
                f"message {message.name} is a CAN FD frame in {config.dbc}: that needs an "
                "interface that can, with options = { fd = true }",
                ("options",),
            )


def has_fast_data(message: Message) -> bool:
    """Whether a CAN FD message's data go at the second bit rate (Vector's attribute CANFD_BRS)."""
    attributes = message.dbc.attributes if message.dbc is not None else {}
    return "CANFD_BRS" in attributes and bool(attributes["CANFD_BRS"].value)


def signal_of(message: Message, name: str, channel: DbcChannelConfig) -> Signal:
    """A channel's signal.

    Raises
    ------
    LinkConfigError
        When the message has none of that name; lists those that it has.
    """
    wanted = channel.signal or name
    for signal in message.signals:
        if signal.name == wanted:
            return signal
    raise LinkConfigError(
        f"message {message.name} has no signal {wanted!r}; it has: "
        + ", ".join(signal.name for signal in message.signals),
        ("channels", name),
    )


def page_of(message: Message, name: str) -> tuple[str, int] | None:
    """The page of a multiplexed message on which a signal stands: multiplexer and its number.

    The first one where it stands on several; None where every frame has it.
    """
    for signal in message.signals:
        if signal.name == name and signal.multiplexer_ids and signal.multiplexer_signal:
            return signal.multiplexer_signal, signal.multiplexer_ids[0]
    return None


def range_of(signal: Signal) -> tuple[float, float, float]:
    """Smallest and largest physical value that a signal can carry, and its step.

    By its bits and by the range in the file, whichever is less; step 0 for a floating-point one.
    """
    low, high = -math.inf, math.inf
    step = 0.0 if signal.is_float else abs(float(signal.scale))
    if not signal.is_float:
        raw = (-(1 << signal.length - 1), (1 << signal.length - 1) - 1)
        if not signal.is_signed:
            raw = (0, (1 << signal.length) - 1)
        low, high = sorted(number * float(signal.scale) + float(signal.offset) for number in raw)
    if signal.minimum is not None:
        low = max(low, float(signal.minimum))
    if signal.maximum is not None:
        high = min(high, float(signal.maximum))
    return low, high, step


def bits_of(signal: Signal) -> list[tuple[int, int]]:
    """Where a signal's bits stand in the frame: first bit and end in each byte, bit 0 lowest."""
    at, bits = signal.start, []
    for _ in range(signal.length):
        bits.append(at)
        if signal.byte_order == "little_endian":
            at += 1
        else:
            at = at - 1 if at % 8 else at + 15
    return [
        (min(in_byte), max(in_byte) + 1)
        for byte in sorted({bit // 8 for bit in bits})
        if (in_byte := [bit for bit in bits if bit // 8 == byte])
    ]


def within_of(message: Message, stated: float | None) -> float:
    """After how long (s) a message that did not come again counts as missing."""
    if stated is not None:
        return stated
    cycle = (message.cycle_time or 0) * 1e-3
    return max(_LEAST_WITHIN, MISSING_AFTER * cycle) if cycle else _DEFAULT_WITHIN


def decoder(message: Message, used: Collection[str]) -> Callable[[bytes], Mapping[str, Any]]:
    """What makes the physical values of some signals from a frame's bytes, worked out beforehand.

    The function that is handed back raises `ValueError` when the frame is too short. Of a
    multiplexed message it hands back the signals that the frame carries.
    """
    from cantools.database.utils import create_encode_decode_formats

    length, name = message.length, message.name

    def whole(data: bytes) -> bytes:
        if len(data) < length:
            raise ValueError(f"{name}: {len(data)} bytes came, the DBC file says {length}")
        return data[:length]

    if message.is_multiplexed():

        def decode_page(data: bytes) -> Mapping[str, Any]:
            values: Mapping[str, Any] = message.decode(whole(data), decode_choices=False)  # type: ignore[assignment]
            return values

        return decode_page

    signals = [signal for signal in message.signals if signal.name in used]
    formats = create_encode_decode_formats(signals, length)
    big = any(signal.byte_order == "big_endian" for signal in signals)
    little = any(signal.byte_order == "little_endian" for signal in signals)
    physical = [(signal.name, signal.conversion.raw_to_scaled) for signal in signals]
    unpack = formats.little_endian.unpack if little else formats.big_endian.unpack

    def decode(data: bytes) -> Mapping[str, Any]:
        data = whole(data)
        raw = unpack(data[::-1] if little else data)
        if big and little:
            raw.update(formats.big_endian.unpack(data))
        values = {}
        for signal, convert in physical:
            values[signal] = convert(raw[signal], False)
        return values

    return decode


def encode(message: Message, values: Mapping[str, float]) -> bytes:
    """A message's data.

    Raises
    ------
    ValueError
        When a value does not fit its signal.
    """
    import cantools

    try:
        carried = message.gather_signals(dict(values)) if message.is_multiplexed() else dict(values)
        return message.encode(carried, scaling=True, strict=True)
    except (cantools.database.EncodeError, OverflowError) as error:
        raise ValueError(f"{message.name}: {error}") from None
