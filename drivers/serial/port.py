"""Opening a serial port, and reading and writing it without ever blocking the event loop.

pyserial opens and configures; a port that has a file descriptor (a device, a pseudo-terminal, a
``socket://``) is then read by the event loop itself, and any other (``rfc2217://``, ``loop://``)
by `drivers.serial.threaded`; ``docs/decisions/0020`` says why.

What is done here about pyserial 3.5 and Linux:

- pyserial sets VMIN = 0: a read then returns nothing both when there is nothing and when the
  other side hung up. VMIN = 1 tells the two apart.
- A pseudo-terminal has no parity and eight bits; glibc reports EINVAL at the second attempt to set
  anything else. Nothing is ever set a second time through pyserial.
- pyserial's lock is advisory. TIOCEXCL makes the kernel refuse the port to anybody else (but root).
- Closing can take long (a driver drains its output, ``socket://`` sleeps 0.3 s): a thread does it.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import fcntl
import os
import select
import termios
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from drivers.awaited import is_there
from drivers.link import LinkDownError, LinkError
from drivers.serial.settings import PortSettings

if TYPE_CHECKING:
    from serial import SerialBase

OPEN_TIMEOUT = 10.0
"""s for a port to open; pyserial waits 5 s for a ``socket://``."""
CLOSE_TIMEOUT = 5.0
DRAIN = 0.5
"""s that the rest may take to leave before a port is closed."""
MOST_UNSENT = 1 << 16
"""Bytes that may wait to be sent."""

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

    def drain(self) -> None:
        """Hand over now what has come already, so that it cannot pass for what is asked next."""

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


async def open_port(
    config: PortSettings, on_data: Callable[[bytes], None], on_lost: Callable[[str], None]
) -> Port:
    """Open a port, exclusively.

    Parameters
    ----------
    config
        Port, speed, flow control.
    on_data
        Called in the event loop with what was received.
    on_lost
        Called once, with the reason, when the port is lost; not when it is closed.

    Raises
    ------
    LinkDownError
        When it does not open; says why.
    """
    loop = asyncio.get_running_loop()
    opening = loop.run_in_executor(None, _open, config)
    try:
        opened = await asyncio.wait_for(asyncio.shield(opening), OPEN_TIMEOUT)
    except TimeoutError:
        opening.add_done_callback(_close_late)
        raise LinkDownError(f"{config.port} does not open in {OPEN_TIMEOUT:g} s") from None
    except asyncio.CancelledError:
        opening.add_done_callback(_close_late)
        raise
    except Exception as error:
        # each of pyserial's handlers raises its own
        raise LinkDownError(f"cannot open {config.port}: {_reason(error)}") from error
    try:
        fd = opened.fileno()
    except (OSError, AttributeError):
        from drivers.serial.threaded import ThreadedPort

        return ThreadedPort(opened, on_data, on_lost)
    return FdPort(opened, fd, on_data, on_lost)


def _open(config: PortSettings) -> SerialBase:
    import serial

    opened = serial.serial_for_url(
        config.path_or_url,
        baudrate=config.baudrate,
        bytesize=config.bytesize,
        parity=config.parity,
        stopbits=config.stopbits,
        xonxoff=config.flow == "xonxoff",
        rtscts=config.flow == "rtscts",
        dsrdtr=config.flow == "dsrdtr",
        timeout=0.1,
        exclusive=True,
    )
    try:
        fd = opened.fileno()
    except (OSError, AttributeError):
        return opened
    if os.isatty(fd):
        attributes = termios.tcgetattr(fd)
        attributes[6][termios.VMIN] = 1
        termios.tcsetattr(fd, termios.TCSANOW, attributes)
        termios.tcflush(fd, termios.TCIFLUSH)
        fcntl.ioctl(fd, termios.TIOCEXCL)
    return opened


def _reason(error: Exception) -> str:
    """What the operating system says, in short."""
    number = getattr(error, "errno", None)
    if number in _HINTS:
        return _HINTS[number]
    return os.strerror(number) if isinstance(number, int) else str(error)


def _in_driver(fd: int) -> int:
    """Bytes that the driver has not sent yet."""
    try:
        return int.from_bytes(fcntl.ioctl(fd, termios.TIOCOUTQ, b"\0\0\0\0"), "little")
    except OSError:
        return 0


def _close_late(opening: asyncio.Future[SerialBase]) -> None:
    """Close a port that opened after all."""
    if not opening.cancelled() and opening.exception() is None:
        asyncio.get_running_loop().run_in_executor(None, opening.result().close)


class FdPort:
    """A port with a file descriptor, served by the event loop."""

    def __init__(
        self,
        opened: SerialBase,
        fd: int,
        on_data: Callable[[bytes], None],
        on_lost: Callable[[str], None],
    ) -> None:
        self._opened = opened
        self._fd = fd
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

    def drain(self) -> None:
        """As `Port.drain`."""
        if self._closing is None and self._there.poll(0):
            self._readable()

    def wait(self, seconds: float) -> bool:
        """As `Port.wait`."""
        if self._closing is not None or not is_there(self._fd, seconds):
            return False
        self._readable()
        return True

    @property
    def unsent(self) -> int:
        """Bytes here and in the driver; what an adapter holds is not known."""
        return len(self._unsent) + _in_driver(self._fd)

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
        while _in_driver(self._fd):
            if time.monotonic() > deadline:
                termios.tcflush(self._fd, termios.TCOFLUSH)
                return
            time.sleep(0.01)

    def _readable(self) -> None:
        try:
            data = os.read(self._fd, 4096)
        except BlockingIOError:
            return
        except OSError as error:
            self._lose(f"the port was lost: {_reason(error)}")
            return
        if data:
            self._on_data(data)
        else:
            self._lose("the other side hung up (unplugged?)")

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
            why = f"the port was lost: {_reason(error)}"
            self._lose(why)
            raise LinkDownError(why) from error

    def _lose(self, why: str) -> None:
        self.close()
        self._on_lost(why)
