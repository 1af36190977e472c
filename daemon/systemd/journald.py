"""Events for systemd's journal, with fields that ``journalctl`` can select by.

The journal's native protocol: one datagram of ``FIELD=value`` lines to its socket
(systemd.journal-fields(7); https://systemd.io/JOURNAL_NATIVE_PROTOCOL). An event's time and level
are fields there, and so not in its text.
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import sys
from collections.abc import Mapping
from typing import Self

_SOCKET = "/run/systemd/journal/socket"
_LEVELS = (
    (logging.CRITICAL, 2),
    (logging.ERROR, 3),
    (logging.WARNING, 4),
    (logging.INFO, 6),
)
_DEBUG = 7
_LONGEST = 60_000
"""Bytes of a field; a datagram that is too large would be lost whole."""


class JournaldHandler(logging.Handler):
    """Sends log records to systemd's journal; never waits, and loses what it does not take.

    What an event is about is given with it, ``logger.info(…, extra={"about": {"AXIS": "X"}})``, and
    becomes fields ``ABBE_AXIS`` and so on.

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
        """The journal that standard error is connected to; None where it is not.

        ``JOURNAL_STREAM`` names it by device and inode, as whoever redirects standard error leaves
        the variable as it was.
        """
        device, _, inode = environment.get("JOURNAL_STREAM", "").partition(":")
        try:
            mine = os.fstat(sys.stderr.fileno())
            if (mine.st_dev, mine.st_ino) != (int(device), int(inode)):
                return None
            return cls()
        except (OSError, ValueError):
            return None

    def emit(self, record: logging.LogRecord) -> None:
        """Send one event."""
        try:
            message = record.getMessage()
            if record.exc_info:
                message += "\n" + logging.Formatter().formatException(record.exc_info)
            fields = {
                "MESSAGE": message,
                "PRIORITY": str(next((p for n, p in _LEVELS if record.levelno >= n), _DEBUG)),
                "SYSLOG_IDENTIFIER": "abbe",
                "ABBE_PART": record.name,
            }
            about: Mapping[str, object] = getattr(record, "about", {})
            fields |= {f"ABBE_{key.upper()}": str(value) for key, value in about.items()}
            datagram = b"".join(_field(key, value) for key, value in fields.items())
        except Exception:  # noqa: BLE001  (as logging's own handlers: the event is at fault)
            self.handleError(record)
            return
        with contextlib.suppress(OSError):
            self._socket.send(datagram)

    def close(self) -> None:
        """Give the socket back."""
        self._socket.close()
        super().close()


def _field(key: str, value: str) -> bytes:
    """One field: ``KEY=value``, or with its length where the value has several lines."""
    data = value.encode("utf-8", "backslashreplace")[:_LONGEST]
    if b"\n" not in data:
        return key.encode() + b"=" + data + b"\n"
    return key.encode() + b"\n" + len(data).to_bytes(8, "little") + data + b"\n"
