"""The contract of an open serial port, and what the operating system says of one."""

from __future__ import annotations

import errno
import fcntl
import os
import termios
from typing import Protocol

CLOSE_TIMEOUT = 5.0

_HINTS = {
    errno.ENOENT: "there is no such device (unplugged?)",
    errno.EACCES: "not allowed (is the user in the group 'dialout'?)",
    errno.EAGAIN: "locked: another program has it",
    errno.EBUSY: "locked: another program has it",
}


class Port(Protocol):
    """An open serial port."""

    def write(self, data: bytes) -> None:
        """Send, or queue what the driver does not take at once.

        Raises
        ------
        LinkError
            When too much waits already.
        LinkDownError
            When the port is gone.
        """

    def drain(self) -> bool:
        """Hand over now what has come already, so that it cannot pass for what is asked next.

        False when there is no end to it.
        """

    def discard(self) -> None:
        """Forget what has not left yet: it must not leave later. The port is then to be closed."""

    @property
    def since(self) -> float:
        """Monotonic time in s before which nothing came of what is being handed over.

        Nothing was waiting to be read then. Not when it came: whoever is stalled finds old bytes.
        """

    def wait(self, seconds: float) -> bool:
        """Wait on the spot until something has come, at most so long (s), and hand it over.

        False when nothing came, or the port cannot be waited for.
        """

    @property
    def unsent(self) -> int:
        """Bytes that have not left yet, as far as is known."""

    def close(self) -> None:
        """Give the port up; `closed` waits for the end. Safe to call twice."""

    async def closed(self) -> None:
        """Wait (bounded) until the port can be opened again."""


def reason_of(error: Exception) -> str:
    """What the operating system says, in short."""
    number = getattr(error, "errno", None)
    if number in _HINTS:
        return _HINTS[number]
    return os.strerror(number) if isinstance(number, int) else str(error)


def in_driver(fd: int) -> int:
    """Bytes that the driver has not sent yet; of a connection, those that did not arrive."""
    try:
        return int.from_bytes(fcntl.ioctl(fd, termios.TIOCOUTQ, b"\0\0\0\0"), "little")
    except OSError:
        return 0
