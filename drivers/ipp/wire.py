"""Lines of an I++ DME server: cut from the stream, taken apart into tag, kind and text.

A line ends with CR LF and holds at most 65 536 characters of ASCII 32 to 126; a
response is five characters of tag, a blank, one of ``& # ! %``, and for data and errors a blank
and the text. Tags are ``00001`` to ``99999``, for events ``E0001`` to ``E9999``; ``E0000`` is what
the server says unasked.
"""

from __future__ import annotations

import enum
import re
from collections.abc import Iterator
from typing import NamedTuple

from abbe.drivers.serial.port.lines import Splitter

LONGEST = 65_536
"""Characters that a line may have."""

# The standard is not of one mind on the blank behind the sign: its grammar has none, its text one.
_RESPONSE = re.compile(rb"(\d{5}|E\d{4}) ([&#!%])(?: ?([ -~]*))?", re.ASCII)


class ResponseKind(enum.Enum):
    """The kind of a response line."""

    TAKEN = "&"
    """The command was received."""
    DATA = "#"
    ERROR = "!"
    DONE = "%"
    """The command is completed; nothing more comes with its tag, events excepted."""


class ResponseLine(NamedTuple):
    """One response line.

    Attributes
    ----------
    tag
        The command's tag, or an event's.
    kind
        What it is.
    text
        What stands behind the sign; empty for `ResponseKind.TAKEN` and `ResponseKind.DONE`.
    """

    tag: str
    kind: ResponseKind
    text: str


class Cutter:
    """Bytes in, messages out, however the bytes are cut into packets.

    Attributes
    ----------
    strays
        Lines that were no responses.
    last_stray
        The beginning of the last of them, for people.
    """

    def __init__(self) -> None:
        self._splitter = Splitter(b"\n", LONGEST)
        self._own_strays = 0
        self.last_stray = ""

    @property
    def strays(self) -> int:
        """Lines that were no responses, and lines that were too long."""
        return self._own_strays + self._splitter.thrown_away

    def feed(self, data: bytes) -> Iterator[ResponseLine]:
        """Take bytes in; hands out the messages that they complete."""
        for line in self._splitter.feed(data):
            bare = line.strip(b"\r")
            if not bare:
                continue
            message = parsed(bare)
            if message is None:
                self._own_strays += 1
                self.last_stray = repr(bare[:80].decode("latin-1"))
            else:
                yield message


def parsed(line: bytes) -> ResponseLine | None:
    """A line without its end as a message; None when it is none.

    >>> parsed(b'00019 # X(99.93), Y(17.148)')
    ResponseLine(tag='00019', kind=<ResponseKind.DATA: '#'>, text='X(99.93), Y(17.148)')
    """
    found = _RESPONSE.fullmatch(line)
    if found is None:
        return None
    kind, text = ResponseKind(found[2].decode()), (found[3] or b"").decode().strip()
    if text and kind in (ResponseKind.TAKEN, ResponseKind.DONE):
        return None
    return ResponseLine(found[1].decode(), kind, text)
