r"""The configuration section of a serial link: a port, messages on it, values in the messages.

::

    [links.dro]
    driver = "serial"
    port = "/dev/ttyUSB0"
    baudrate = 9600
    terminator = "\r\n"
    [links.dro.messages.position]
    query = "R"                                     # none: the device sends by itself
    pattern = 'X *(?P<x>[-+.\d]+) Y *(?P<y>[-+.\d]+)'
    checksum = { kind = "xor", after = "*" }
    [links.dro.channels.x]
    message = "position"
    unit = "mm"

``docs/serial.md`` is the user's page on each key.
"""

from __future__ import annotations

import math
import re
import string
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from abbe.drivers.quarantine import QuarantineConfig
from abbe.drivers.scaled import ScaledNumber
from abbe.drivers.serial.checksum import ChecksumConfig
from abbe.drivers.serial.patterns import LinePattern, checked
from abbe.drivers.serial.port.settings import PortSettings

_STRICT = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
_WHOLE = "dxX"
"""Presentation types of Python's format that take whole numbers."""


def _step(form: str) -> float:
    """What a number is a multiple of that is written in this form; 0: of nothing."""
    if form[-1:] in tuple(_WHOLE):
        return 1.0
    decimals = re.search(r"\.(\d+)[fF]$", form)
    return 10.0 ** -int(decimals[1]) if decimals else 0.0


def _check(key: str, pattern: str | None) -> None:
    try:
        checked(pattern or "")
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from None


class SerialMessageConfig(BaseModel):
    """One kind of message: how it is asked for, and what it looks like."""

    model_config = _STRICT

    query: str | None = None
    """What to send, without its terminator; none for a message that the device sends by itself."""
    pattern: str
    """Regular expression with named fields, for the whole text of the answer; blanks around it do
    not count."""
    refused: str | None = None
    """Regular expression for an answer by which the device says that it cannot."""
    lines: Annotated[int, Field(ge=1, le=64)] = 1
    """Lines in an answer; the pattern then sees them with ``\\n`` in between."""
    checksum: ChecksumConfig | None = None
    every: Annotated[float, Field(ge=0)] = 0.0
    """s between two queries; 0 asks at every call."""
    within: Annotated[float, Field(gt=0)] = 1.0
    """Without a query: s after which a message that did not come again counts as missing."""

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the pattern's fields."""
        return LinePattern(self.pattern).fields

    @model_validator(mode="after")
    def _consistent(self) -> SerialMessageConfig:
        pattern = checked(self.pattern)
        _check("refused", self.refused)
        if not pattern.fields:
            raise ValueError(
                f"pattern {self.pattern!r} has no named field, e.g. (?P<x>[-+.\\d]+) for x"
            )
        if self.query is None:
            for key in ("lines", "refused", "every"):
                if key in self.model_fields_set:
                    raise ValueError(f"{key}: only for a message with a query")
        elif "within" in self.model_fields_set:
            raise ValueError("within: only for a message without a query")
        if self.query is not None:
            if not self.query.isascii():
                raise ValueError(f"query {self.query!r} is not ASCII")
            if pattern.fullmatch(self.query.strip()):
                raise ValueError(
                    f"pattern {self.pattern!r} fits the query {self.query!r} itself: "
                    "its echo would pass for the answer"
                )
        return self


class SerialChannelConfig(ScaledNumber):
    """One value: a field of a message, or a command that sets something."""

    model_config = _STRICT

    message: str | None = None
    """Where it is read from."""
    field: str | None = None
    """Which field of the message; default the one of the channel's name."""
    base: Literal[10, 16] = 10
    bits: Annotated[int, Field(ge=4, le=64)] | None = None
    """For base 16: width of a two's complement number; none, it has no sign."""
    decimal: Literal[".", ","] = "."
    values: dict[str, float] | None = None
    """Instead of a number: text of the field → value, e.g. ``{ OK = 1, ERR = 0 }``."""
    unit: str = ""
    """Unit of the value, for people."""
    command: str | None = None
    """What to send to set the value, e.g. ``SX{value:+.4f}``, without its terminator."""
    acknowledge: str | None = None
    """Regular expression for the answer to the command; without one nothing confirms it."""
    refused: str | None = None
    """Regular expression for an answer by which the device says that it cannot."""
    checksum: ChecksumConfig | None = None
    """Of the command and of its answer."""

    @property
    def writable(self) -> bool:
        """Whether the channel is a command."""
        return self.command is not None

    @property
    def range(self) -> tuple[float, float, float]:
        """Smallest and largest value that its form can carry, and its step, in `unit`.

        Infinite, and 0, where the form does not say; a decimal number has no bounds.
        """
        low, high, step = -math.inf, math.inf, 0.0
        if self.values:
            low, high = min(self.values.values()), max(self.values.values())
        elif self.command is not None:
            step = _step(self._form)
        elif self.base == 16:
            low, step = 0.0, 1.0
            if self.bits is not None:
                low, high = -(2.0 ** (self.bits - 1)), 2.0 ** (self.bits - 1) - 1.0
        return *self.range_of(low, high), step * abs(self.scale)

    def text_of(self, value: float) -> str:
        """The command that sets a value (in the channel's unit).

        Raises
        ------
        ValueError
            When the value is not finite.
        """
        number = self.number_of(value)
        whole = self._form[-1:] in tuple(_WHOLE)
        if number - number != 0.0:
            raise ValueError(f"{value} cannot be sent")
        return self._template.format(value=round(number) if whole else number)

    @property
    def _form(self) -> str:
        """How the number is written, in Python's format."""
        ((_, _, form, _),) = [p for p in string.Formatter().parse(self._template) if p[1]]
        return form or ""

    @property
    def _template(self) -> str:
        assert self.command is not None  # noqa: S101 - the validator saw to it
        return self.command

    @model_validator(mode="after")
    def _consistent(self) -> SerialChannelConfig:
        if (self.message is None) == (self.command is None):
            raise ValueError("needs either message (it is read) or command (it is written)")
        if self.command is None:
            for key in ("acknowledge", "refused", "checksum"):
                if getattr(self, key) is not None:
                    raise ValueError(f"{key}: only for a channel with command")
        else:
            self._check_command()
        if self.values is not None and (self.base, self.bits, self.decimal) != (10, None, "."):
            raise ValueError("values stand in place of numbers: no base, bits or decimal")
        if self.bits is not None and self.base != 16:
            raise ValueError("bits: only for base = 16")
        return self

    def _check_command(self) -> None:
        command = self._template
        if self.field is not None or self.values is not None:
            raise ValueError("field and values: only for a channel with message")
        try:
            names = [part[1] for part in string.Formatter().parse(command) if part[1] is not None]
            if names != ["value"]:
                raise ValueError("expected {value} once")
            self.text_of(self.offset)
        except ValueError as error:
            raise ValueError(f"command {command!r}: {error}") from None
        if not command.isascii():
            raise ValueError(f"command {command!r} is not ASCII")
        _check("acknowledge", self.acknowledge)
        _check("refused", self.refused)


class LineConfig(QuarantineConfig, PortSettings):
    """One serial line and how lines of text go over it. Times are in s."""

    model_config = _STRICT

    terminator: Annotated[str, Field(min_length=1)] = "\r\n"
    """What ends a line that is received."""
    query_terminator: str | None = None
    """What ends a line that is sent; default the same."""
    max_line: Annotated[int, Field(ge=8, le=4096)] = 128
    """Characters that a line may have; one more, and it is no line."""
    local_echo: bool = False
    """The adapter hears what it sends (two-wire RS-485 without echo suppression)."""
    pause: Annotated[float, Field(ge=0)] = 0.0
    """s between an answer and the next query, for slow devices."""
    late_reply_max: Annotated[float, Field(gt=0)] = 1.0
    """s after a query beyond which its answer cannot come any more."""
    on_open: tuple[str, ...] = Field(default=(), strict=False)
    """Lines to send once the port is open, e.g. what switches a device to remote."""
    max_waiting: Annotated[int, Field(ge=1)] = 16
    """Calls that may wait for the line; one more is turned away at once."""

    @model_validator(mode="after")
    def _ends_are_ascii(self) -> LineConfig:
        for key in ("terminator", "query_terminator"):
            text = getattr(self, key)
            if text is not None and not text.isascii():
                raise ValueError(f"{key} {text!r} is not ASCII")
        return self


class SerialConfig(LineConfig):
    """One serial line and what is said on it."""

    messages: dict[str, SerialMessageConfig] = Field(default_factory=dict)
    channels: Annotated[dict[str, SerialChannelConfig], Field(min_length=1)]

    @property
    def streaming(self) -> bool:
        """Whether the device sends by itself."""
        return any(message.query is None for message in self.messages.values())

    def field_of(self, channel: str) -> str:
        """Field in which a channel that is read stands."""
        return self.channels[channel].field or channel

    @model_validator(mode="after")
    def _channels_fit_together(self) -> SerialConfig:
        asked = [name for name, message in self.messages.items() if message.query is not None]
        if asked and self.streaming:
            raise ValueError(
                "some messages have a query and some do not: a device is either asked "
                f"({', '.join(asked)}) or sends by itself"
            )
        for name, channel in self.channels.items():
            if channel.message is None:
                if self.streaming and channel.acknowledge is not None:
                    raise ValueError(
                        f"channel {name!r}: acknowledge cannot be distinguished from what "
                        "the device sends by itself"
                    )
                continue
            message = self.messages.get(channel.message)
            if message is None:
                known = ", ".join(self.messages) or "none"
                raise ValueError(
                    f"channel {name!r}: message {channel.message!r} is not defined; "
                    f"there are: {known}"
                )
            if (field := self.field_of(name)) not in message.fields:
                raise ValueError(
                    f"channel {name!r}: message {channel.message!r} has no field {field!r}; "
                    f"its pattern has: {', '.join(message.fields)}"
                )
        used = {channel.message for channel in self.channels.values()}
        if idle := [name for name in self.messages if name not in used]:
            raise ValueError(f"message {idle[0]!r} is used by no channel")
        return self
