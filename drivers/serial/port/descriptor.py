"""A serial port that has a file descriptor, served by the event loop.

What it does when it is closed or withdrawn: a driver that still has characters is told to forget
them, a connection that has bytes which did not arrive is reset, so that nothing leaves later.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import select
import socket
import struct
import termios
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from abbe.drivers.link import LinkDownError, LinkError
from abbe.drivers.reply_wait import is_there
from abbe.drivers.serial.port.port import CLOSE_TIMEOUT, in_driver, reason_of

if TYPE_CHECKING:
    from serial import SerialBase

DRAIN = 0.5
"""s that the rest may take to leave before a port is closed."""
MOST_UNSENT = 1 << 16
"""Bytes that may wait to be sent."""
_MOST_READS = 32
"""Pieces (of at most 4 KiB) that are handed over before others get their turn."""


class FdPort:
    """A port with a file descriptor, served by the event loop."""

    def __init__(
        self,
        opened: SerialBase,
        fd: int,
        since: float,
        on_data: Callable[[bytes], None],
        on_lost: Callable[[str], None],
    ) -> None:
        self._opened = opened
        self._fd = fd
        self._since = since
        self._on_data = on_data
        self._on_lost = on_lost
        self._unsent = bytearray()
        self._closing: asyncio.Future[None] | None = None
        self._loop = asyncio.get_running_loop()
        self._there = select.poll()
        self._there.register(fd, select.POLLIN)
        os.set_blocking(fd, False)
        self._loop.add_reader(fd, self._readable)

    def write(self, data: bytes) -> None:
        """As `Port.write`."""
        if self._closing is not None:
            raise LinkDownError("the port is closed")
        if self._unsent:
            if len(self._unsent) + len(data) > MOST_UNSENT:
                raise LinkError(f"{len(self._unsent)} bytes wait to be sent: the device stopped us")
            self._unsent += data
            return
        sent = self._send(data)
        if sent < len(data):
            self._unsent += data[sent:]
            self._loop.add_writer(self._fd, self._writable)

    def drain(self) -> bool:
        """As `Port.drain`."""
        if self._closing is not None:
            return True
        looked = time.monotonic()
        if self._there.poll(0):
            return self._readable()
        self._since = looked
        return True

    def discard(self) -> None:
        """As `Port.discard`."""
        if self._closing is None:
            self._unsent.clear()
            self._loop.remove_writer(self._fd)
            self._forget()

    @property
    def since(self) -> float:
        """As `Port.since`."""
        return self._since

    def wait(self, seconds: float) -> bool:
        """As `Port.wait`."""
        if self._closing is not None or not is_there(self._fd, seconds):
            return False
        self._read()
        return True

    @property
    def unsent(self) -> int:
        """Bytes here and in the driver; what an adapter holds is not known."""
        return len(self._unsent) + in_driver(self._fd)

    def close(self) -> None:
        """As `Port.close`."""
        if self._closing is not None:
            return
        self._loop.remove_reader(self._fd)
        self._loop.remove_writer(self._fd)
        self._closing = self._loop.run_in_executor(None, self._close)

    async def closed(self) -> None:
        """As `Port.closed`."""
        if self._closing is not None:
            await asyncio.wait([self._closing], timeout=CLOSE_TIMEOUT)

    def _close(self) -> None:
        if os.isatty(self._fd):
            with contextlib.suppress(OSError, termios.error):
                fcntl.ioctl(self._fd, termios.TIOCNXCL)
        self._flush()
        with contextlib.suppress(OSError, termios.error):
            self._opened.close()

    def _flush(self) -> None:
        """Give the driver a moment to send the rest, then have it forget what is stuck."""
        deadline = time.monotonic() + DRAIN
        while in_driver(self._fd):
            if time.monotonic() > deadline:
                self._forget()
                return
            time.sleep(0.01)

    def _forget(self) -> None:
        """Have the driver forget what it has not sent; a connection is reset when it is closed."""
        with contextlib.suppress(OSError, termios.error):
            if os.isatty(self._fd):
                termios.tcflush(self._fd, termios.TCOFLUSH)
                return
            with socket.socket(fileno=os.dup(self._fd)) as connection:
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))

    def _readable(self) -> bool:
        """Hand over all that is there; False when there is no end to it."""
        for _ in range(_MOST_READS):
            if not self._read() or self._closing is not None:
                return True
            looked = time.monotonic()
            if not self._there.poll(0):
                self._since = looked
                return True
        return False

    def _read(self) -> bool:
        try:
            data = os.read(self._fd, 4096)
        except BlockingIOError:
            return False
        except OSError as error:
            self._lose(f"the port was lost: {reason_of(error)}")
            return False
        if data:
            self._on_data(data)
        else:
            self._lose("the other side hung up (unplugged?)")
        return bool(data)

    def _writable(self) -> None:
        try:
            sent = self._send(bytes(self._unsent))
        except LinkDownError:
            return
        del self._unsent[:sent]
        if not self._unsent:
            self._loop.remove_writer(self._fd)

    def _send(self, data: bytes) -> int:
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0
        except OSError as error:
            why = f"the port was lost: {reason_of(error)}"
            self._lose(why)
            raise LinkDownError(why) from error

    def _lose(self, why: str) -> None:
        self.close()
        self._on_lost(why)
