"""The stream of cycles of a run, read over the Unix socket of its HTTP interface."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import h11

_READ = 65_536
_LONGEST = 1_000_000
"""Bytes of one event."""
_QUIET = 25.0
"""s without a byte after which nobody is there any more; the run says something every 10 s."""


async def streamed_cycles(socket: Path, every: float) -> AsyncIterator[dict[str, Any]]:
    """Every `StreamedCycle` as it comes, until the stream ends.

    Parameters
    ----------
    socket
        The ``[http]`` socket of the run.
    every
        s from one cycle to the next.

    Raises
    ------
    OSError
        When nobody listens there, who asks may not, or nothing comes any more.
    """
    reader, writer = await asyncio.open_unix_connection(socket)
    try:
        connection = h11.Connection(h11.CLIENT)
        target = f"/api/v1/cycles?every={every:g}"
        asked = h11.Request(method="GET", target=target, headers=[("host", "abbe")])
        for part in (asked, h11.EndOfMessage()):
            writer.write(connection.send(part) or b"")
        waiting = b""
        while True:
            event = connection.next_event()
            if event is h11.NEED_DATA:
                async with asyncio.timeout(_QUIET):
                    connection.receive_data(await reader.read(_READ))
            elif isinstance(event, h11.Data):
                *whole, waiting = (waiting + bytes(event.data)).split(b"\n\n")
                for block in whole:
                    for cycle in _cycles(block):
                        yield cycle
                if len(waiting) > _LONGEST:
                    return
            elif isinstance(event, h11.Response):
                if event.status_code != 200:
                    return
            else:
                return
    except h11.RemoteProtocolError:
        return
    finally:
        writer.close()
        with contextlib.suppress(OSError):
            await writer.wait_closed()


def _cycles(block: bytes) -> Iterator[dict[str, Any]]:
    """The cycle of an event; none of another kind of event."""
    fields = dict(line.partition(b": ")[::2] for line in block.split(b"\n"))
    if fields.get(b"event") == b"cycle":
        with contextlib.suppress(ValueError):
            found = json.loads(fields.get(b"data", b""))
            if isinstance(found, dict):
                yield found
