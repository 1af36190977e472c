"""Questions on a serial line: messages and commands, and what their answers look like."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from abbe.drivers.link import LinkProtocolError
from abbe.drivers.pace import Pace
from abbe.drivers.quarantine import Member
from abbe.drivers.serial.checksum import ChecksumConfig, ChecksumError, shown
from abbe.drivers.serial.config import LineConfig, SerialConfig
from abbe.drivers.serial.fields import FieldError, compile_reader
from abbe.drivers.serial.patterns import LinePattern, Match

Reader = Callable[[str | None], float]


class DeviceRefusedError(LinkProtocolError):
    """The device answered that it cannot."""


class SerialQuestion(Member):
    """One message or command: how to ask, what answers, what may still come.

    Parameters
    ----------
    name
        For people: ``message position``.
    pattern
        Of the whole answer's text.
    lines
        Lines in an answer.
    checksum
        Of each line.
    refused
        Pattern of an answer by which the device says that it cannot.

    Attributes
    ----------
    asked_at
        Monotonic time in s of a query whose answer may still come; None when none can.
    last_text
        Of the last answer that was right.
    """

    __slots__ = ("_checksum", "_refused", "asked_at", "last_text", "lines", "pattern")

    def __init__(
        self,
        name: str,
        pattern: str,
        lines: int = 1,
        checksum: ChecksumConfig | None = None,
        refused: str | None = None,
    ) -> None:
        super().__init__(name)
        self.pattern = LinePattern(pattern)
        self._refused = None if refused is None else LinePattern(refused)
        self.lines = lines
        self.asked_at: float | None = None
        self.last_text: str | None = None
        self._checksum = checksum

    def text_of(self, lines: Sequence[bytes]) -> str:
        """The text that the pattern is for, checksums checked and taken off.

        Raises
        ------
        LinkProtocolError
            When a checksum is wrong.
        """
        check = self._checksum
        if check is not None:
            try:
                lines = [check.take(line) for line in lines]
            except ChecksumError as error:
                raise LinkProtocolError(f"{self.name}: {error}") from None
        return b"\n".join(lines).decode("latin-1").strip()

    def match(self, lines: Sequence[bytes]) -> Match:
        """The fields of an answer.

        Raises
        ------
        DeviceRefusedError
            When the device says that it cannot.
        LinkProtocolError
            When a checksum is wrong or the text does not fit the pattern.
        """
        text = self.text_of(lines)
        found = self.pattern.fullmatch(text)
        if found is None:
            if self._refused is not None and self._refused.fullmatch(text):
                raise DeviceRefusedError(f"{self.name}: the device answers {text!r}")
            raise LinkProtocolError(
                f"{self.name}: {shown(text.encode('latin-1'))} came, "
                f"which does not fit {self.pattern.text!r}"
            )
        self.last_text = text
        return found

    def fits(self, line: bytes) -> bool:
        """Whether a line could be its answer."""
        try:
            return self.pattern.fullmatch(self.text_of([line])) is not None
        except LinkProtocolError:
            return False

    def confusable(self, other: SerialQuestion) -> bool:
        """Whether an answer to `other` that comes late could pass for an answer to this."""
        if self is other or self.lines != 1 or other.lines != 1:
            return True
        if self.pattern.text == other.pattern.text:
            return True
        mine, theirs = self.last_text, other.last_text
        return (theirs is not None and self.pattern.fullmatch(theirs) is not None) or (
            mine is not None and other.pattern.fullmatch(mine) is not None
        )


class SerialMessage(SerialQuestion):
    """One message of the configuration.

    Attributes
    ----------
    query
        What is sent to get it, complete; empty for what the device sends by itself.
    pace
        When it is due.
    within
        As configured.
    readers
        Channel → the field's name and how its text becomes the value.
    """

    __slots__ = ("_channels", "_fields", "_readers", "pace", "query", "readers", "within")

    def __init__(self, name: str, config: SerialConfig) -> None:
        section = config.messages[name]
        super().__init__(
            f"message {name}", section.pattern, section.lines, section.checksum, section.refused
        )
        self.pace = Pace(section.every)
        self.within = section.within
        self.query = b""
        if section.query is not None:
            self.query = framed(config, section.query, section.checksum)
        self.readers: dict[str, tuple[str, Reader]] = {
            channel: (config.field_of(channel), compile_reader(part))
            for channel, part in config.channels.items()
            if part.message == name
        }
        self._channels = tuple(self.readers)
        self._fields = tuple(field for field, _ in self.readers.values())
        self._readers = tuple(reader for _, reader in self.readers.values())

    def texts(self, found: Match) -> Iterable[tuple[str, str | None, Reader]]:
        """Of each channel in an answer: name, its field's text, and what reads that."""
        fields = self._fields
        texts: Sequence[str | None]
        texts = found.group(*fields) if len(fields) > 1 else (found[fields[0]],)
        return zip(self._channels, texts, self._readers, strict=True)

    def value(self, channel: str, found: Match) -> float:
        """A channel's value in an answer.

        Raises
        ------
        FieldError
            When the field's text is not what the channel expects; says which channel.
        """
        field, reader = self.readers[channel]
        try:
            return reader(found[field])
        except FieldError as error:
            raise FieldError(f"{channel}: {error}") from None


def framed(config: LineConfig, text: str, checksum: ChecksumConfig | None) -> bytes:
    """A line to be sent, complete with checksum and terminator."""
    line = text.encode("ascii")
    if checksum is not None and checksum.queries:
        line = checksum.add(line)
    end = config.terminator if config.query_terminator is None else config.query_terminator
    return line + end.encode("ascii")
