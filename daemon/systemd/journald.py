"""Events for systemd's journal, with fields that ``journalctl`` can select by.

The journal's native protocol: one datagram of ``FIELD=value`` lines to its socket
(systemd.journal-fields(7); https://systemd.io/JOURNAL_NATIVE_PROTOCOL). An event's time and level
are fields there, and so not in its text. What an event is about stands at its beginning by custom
(``link cmm: …``, ``axis X: …``, ``signal T_x1: …``), or is given with it, and is a field too.
"""

from __future__ import annotations

import contextlib
import logging
import os
import re
import socket
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Self, TextIO

from abbe.daemon.systemd.messages import message_id

_SOCKET = "/run/systemd/journal/socket"
_LEVELS = (
    (logging.CRITICAL, 2),
    (logging.ERROR, 3),
    (logging.WARNING, 4),
    (logging.INFO, 6),
)
_DEBUG = 7
_SUBJECT = re.compile(r"(link|axis|signal) ([^\s:(]+)")
_LONGEST = 60_000
"""Bytes of a field; a datagram that is too large would be lost whole."""


class JournaldHandler(logging.Handler):
    """Sends log records to systemd's journal; never waits, and loses what it does not take.

    Fields: ``MESSAGE``, ``PRIORITY``, ``PART`` (of Abbe, that says it), ``LINK``, ``AXIS``,
    ``SIGNAL`` by what the message begins with or ``extra={"about": {"AXIS": ("X", "Y")}}``, and
    ``MESSAGE_ID`` by ``extra={"event": "link lost"}`` (`abbe.daemon.systemd.messages`).

    Parameters
    ----------
    address
        Path of the journal's socket.
    """

    def __init__(self, address: str = _SOCKET) -> None:
        super().__init__()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._socket.setblocking(False)
        try:
            self._socket.connect(address)
        except OSError:
            self._socket.close()
            raise

    @classmethod
    def of_environment(cls, environment: Mapping[str, str] = os.environ) -> Self | None:
        """The journal that standard error is connected to; None where it is not."""
        if not leads_to_journal(sys.stderr, environment):
            return None
        try:
            return cls()
        except OSError:
            return None

    def emit(self, record: logging.LogRecord) -> None:
        """Send one event."""
        try:
            message = record.getMessage()
            if record.exc_info:
                message += "\n" + logging.Formatter().formatException(record.exc_info)
            datagram = b"".join(_field(key, value) for key, value in _fields(record, message))
        except Exception:  # noqa: BLE001  (as logging's own handlers: the event is at fault)
            self.handleError(record)
            return
        with contextlib.suppress(OSError):
            self._socket.send(datagram)

    def close(self) -> None:
        """Give the socket back."""
        self._socket.close()
        super().close()


def leads_to_journal(stream: TextIO, environment: Mapping[str, str] = os.environ) -> bool:
    """Whether a stream is connected to systemd's journal.

    ``JOURNAL_STREAM`` names that by device and inode, as whoever redirects a stream leaves the
    variable as it was.
    """
    device, _, inode = environment.get("JOURNAL_STREAM", "").partition(":")
    try:
        mine = os.fstat(stream.fileno())
        return (mine.st_dev, mine.st_ino) == (int(device), int(inode))
    except (OSError, ValueError):
        return False


def _fields(record: logging.LogRecord, message: str) -> Iterator[tuple[str, str]]:
    yield "MESSAGE", message
    yield "PRIORITY", str(next((p for n, p in _LEVELS if record.levelno >= n), _DEBUG))
    yield "SYSLOG_IDENTIFIER", "abbe"
    yield "PART", record.name
    if event := getattr(record, "event", ""):
        yield "MESSAGE_ID", message_id(event)
    about: Mapping[str, str | Sequence[str]] = getattr(record, "about", {})
    if not about and (found := _SUBJECT.match(message)):
        about = {found[1]: found[2]}
    for key, values in about.items():
        for value in (values,) if isinstance(values, str) else values:
            yield key.upper(), value


def _field(key: str, value: str) -> bytes:
    """One field: ``KEY=value``, or with its length where the value has several lines."""
    data = value.encode("utf-8", "backslashreplace")[:_LONGEST]
    if b"\n" not in data:
        return key.encode() + b"=" + data + b"\n"
    return key.encode() + b"\n" + len(data).to_bytes(8, "little") + data + b"\n"
