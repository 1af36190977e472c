"""Lines that are sent soon or not at all: a device that stops us must not get them later."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

from abbe.drivers.link import LinkDownError, TooLateError
from abbe.drivers.serial.port.port import Port

_LOOK = 0.002
"""s between two looks at whether everything has left."""


async def see_sent(
    port: Port, data: bytes, until: float, limit: float, on_lost: Callable[[str], None]
) -> None:
    """Send a line that nobody answers, and wait until it has left, as far as that is known.

    Parameters
    ----------
    port
        Where.
    data
        The line.
    until
        Monotonic time in s after which it must not leave.
    limit
        s that it may take to leave.
    on_lost
        Called with the reason when it does not; the port is of no use then.

    Raises
    ------
    TooLateError
        When it is too late already; nothing was sent.
    LinkDownError
        When the device does not let it out.
    """
    now = time.monotonic()
    if now > until:
        raise TooLateError("too old before it could be sent, so not sent")
    port.write(data)
    last = min(until, now + limit)
    while port.unsent:
        if time.monotonic() > last:
            raise withdrawn(port, on_lost)
        await asyncio.sleep(_LOOK)


def withdrawn(port: Port, on_lost: Callable[[str], None]) -> LinkDownError:
    """Take back what has not left, give the port up, and hand back the error that says so.

    Half a line may have left; a port that is opened anew begins with a whole one.
    """
    count = port.unsent
    port.discard()
    why = f"the device takes no more characters ({count} were withdrawn)"
    on_lost(why)
    return LinkDownError(why)
