"""Opening a serial port, which is then read and written without ever blocking the event loop.

pyserial opens and configures; a port that has a file descriptor (a device, a pseudo-terminal, a
``socket://``) is then served by `abbe.drivers.serial.port.descriptor`, any other (``rfc2217://``, ``loop://``)
by `abbe.drivers.serial.port.threaded`; ``docs/decisions/0020`` says why.

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
import errno
import fcntl
import os
import termios
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from abbe.drivers.link import LinkDownError
from abbe.drivers.serial.port.settings import PortSettings

if TYPE_CHECKING:
    from serial import SerialBase

OPEN_TIMEOUT = 10.0
"""s for a port to open; pyserial waits 5 s for a ``socket://``."""
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
    since = time.monotonic()
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
        raise LinkDownError(f"cannot open {config.port}: {reason_of(error)}") from error
    try:
        fd = opened.fileno()
    except (OSError, AttributeError):
        from abbe.drivers.serial.port.threaded import ThreadedPort

        return ThreadedPort(opened, since, on_data, on_lost)
    from abbe.drivers.serial.port.descriptor import FdPort

    return FdPort(opened, fd, since, on_data, on_lost)


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
        timeout=0.02,
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


def _close_late(opening: asyncio.Future[SerialBase]) -> None:
    """Close a port that opened after all."""
    if not opening.cancelled() and opening.exception() is None:
        asyncio.get_running_loop().run_in_executor(None, opening.result().close)
