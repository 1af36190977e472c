"""A serial adapter's port under python-can's ``slcan``: read in pieces, written without waiting.

python-can 4.6.1 reads it one byte at a time (two system calls each, some 100 µs a frame), and after
each frame that it sends waits until the driver has sent it (tcdrain). Both happen in here, where
`BufferedPort` takes the place of pyserial's port once that is open and configured. It also takes
out what the adapter says of itself, which python-can would pass over.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
import termios
import time
from collections.abc import Callable
from typing import Any

from abbe.drivers.serial.port.port import in_driver

LINE = re.compile(rb"(?<![^\r\a])(F[0-9A-Fa-f]{2}|s[awpb][0-9]{6})\r")
"""A line of an adapter's output that is no frame."""
_DRAIN = 0.1
"""s that the rest may take to leave before the port is closed; it may hold the closing command."""
_LONGEST = 512
"""Bytes of an unfinished line beyond which it is no line of any adapter."""


class BufferedPort:
    """A buffered serial port, as far as ``slcan`` uses one.

    Parameters
    ----------
    port
        The open one, with a file descriptor.

    Attributes
    ----------
    write_timeout
        Set by python-can; nothing is ever waited for.
    on_status
        Called with a line that says something of the adapter, without its end.
    on_refused
        Called when the adapter refused something.
    """

    def __init__(self, port: Any) -> None:
        self._port = port
        self._fd: int = port.fileno()
        self._held = b""
        self._at = 0
        self._begun = b""
        self._unsent = b""
        self.write_timeout: float | None = None
        self.on_status: Callable[[bytes], None] = _pass_over
        self.on_refused: Callable[[], None] = _pass_over
        os.set_blocking(self._fd, False)
        # pyserial's VMIN = 0 makes "nothing there" and "hung up" the same.
        attributes = termios.tcgetattr(self._fd)
        attributes[6][termios.VMIN] = 1
        termios.tcsetattr(self._fd, termios.TCSANOW, attributes)
        fcntl.ioctl(self._fd, termios.TIOCEXCL)

    @property
    def in_waiting(self) -> int:
        """Bytes that are there, of whole lines.

        Raises
        ------
        OSError
            When the adapter is gone.
        """
        self._send_rest()
        left = len(self._held) - self._at
        if left > 0:
            return left
        self._held, self._at = b"", 0
        try:
            came = os.read(self._fd, 4096)
        except BlockingIOError:
            return 0
        if not came:
            raise OSError("the other side hung up (unplugged?)")
        self._held = self._frames_in(came)
        return len(self._held)

    def _frames_in(self, came: bytes) -> bytes:
        """Whole lines that came, but for what they say of the adapter; the rest is kept."""
        text = self._begun + came
        end = max(text.rfind(b"\r"), text.rfind(b"\a")) + 1
        whole, self._begun = text[:end], text[end:]
        if len(self._begun) > _LONGEST:
            self._begun = b""
        lines = LINE.findall(whole)
        if lines:
            whole = LINE.sub(b"", whole)
        refused = b"\a" in whole
        for line in lines:
            self.on_status(line)
        if refused:
            self.on_refused()
        return whole

    @property
    def has_begun(self) -> bool:
        """Whether a line has begun to come."""
        return bool(self._begun)

    @property
    def holds(self) -> bool:
        """Whether bytes are here that the file descriptor does not show any more."""
        return self._at < len(self._held)

    def read(self, size: int = 1) -> bytes:
        """Bytes that are there, at most `size`."""
        if not self.in_waiting:
            return b""
        piece = self._held[self._at : self._at + size]
        self._at += size
        return piece

    def write(self, data: bytes) -> int:
        """Send.

        Raises
        ------
        BlockingIOError
            When the driver has no room; nothing of `data` was sent.
        OSError
            When the adapter is gone.
        """
        self._send_rest()
        if self._unsent:
            raise BlockingIOError(errno.EAGAIN, "the adapter does not take its frames")
        sent = os.write(self._fd, data)
        # the end of a frame that was begun leaves with the next look at the port
        self._unsent = data[sent:]
        return len(data)

    def _send_rest(self) -> None:
        if self._unsent:
            with contextlib.suppress(BlockingIOError):
                self._unsent = self._unsent[os.write(self._fd, self._unsent) :]

    @property
    def unsent(self) -> int:
        """Bytes that have not left yet, as far as is known: here and in the driver."""
        self._send_rest()
        return len(self._unsent) + in_driver(self._fd)

    def discard(self) -> None:
        """Forget what has not left yet; the port is then to be closed."""
        self._unsent = b""
        with contextlib.suppress(OSError, termios.error):
            termios.tcflush(self._fd, termios.TCOFLUSH)

    def flush(self) -> None:
        """Wait for nothing."""

    def reset_input_buffer(self) -> None:
        """Forget what came."""
        self._held, self._at, self._begun, self._unsent = b"", 0, b"", b""
        self._port.reset_input_buffer()

    def fileno(self) -> int:
        """The port's file descriptor."""
        return self._fd

    def close(self) -> None:
        """Close the port; what a stuck adapter did not take is forgotten. Safe to call twice."""
        if self._port.is_open:
            with contextlib.suppress(OSError):
                fcntl.ioctl(self._fd, termios.TIOCNXCL)
                deadline = time.monotonic() + _DRAIN
                while self.unsent and time.monotonic() < deadline:
                    time.sleep(0.002)
                # on a pseudo-terminal that also takes away what the other side has not read yet
                if self.unsent:
                    self.discard()
            self._port.close()


def _pass_over(*_: object) -> None:
    """Nobody wants to know."""
