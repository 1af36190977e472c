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
import fcntl
import os
import termios
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from abbe.drivers.link import LinkDownError
from abbe.drivers.serial.port.descriptor import FdPort
from abbe.drivers.serial.port.port import Port, reason_of
from abbe.drivers.serial.port.settings import PortSettings
from abbe.drivers.serial.port.threaded import ThreadedPort

if TYPE_CHECKING:
    from serial import SerialBase

OPEN_TIMEOUT = 10.0
"""s for a port to open; pyserial waits 5 s for a ``socket://``."""


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
        return ThreadedPort(opened, since, on_data, on_lost)
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


def _close_late(opening: asyncio.Future[SerialBase]) -> None:
    """Close a port that opened after all."""
    if not opening.cancelled() and opening.exception() is None:
        asyncio.get_running_loop().run_in_executor(None, opening.result().close)
