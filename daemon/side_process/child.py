"""The other side: what a process beside a run does with itself before it begins."""

from __future__ import annotations

import asyncio
import contextlib
import os
import resource
import signal
import socket

_NICER = 10
"""By how much it steps back behind the correction."""


def step_back(memory: int) -> None:
    """Be nicer than the correction, fail before its computer does, and leave signals to the run.

    Parameters
    ----------
    memory
        Bytes of its own data that it may have.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    with contextlib.suppress(OSError, AttributeError):
        os.nice(_NICER)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))


async def streams(
    descriptor: int, longest: int
) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """Its end of the connection to the run.

    Parameters
    ----------
    descriptor
        Of the socket, as the run handed it on.
    longest
        Bytes of a line, at most.
    """
    end = socket.socket(fileno=descriptor)
    end.setblocking(False)
    return await asyncio.open_unix_connection(sock=end, limit=longest)
