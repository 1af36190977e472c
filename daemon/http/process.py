"""The HTTP process: ``python -m abbe.daemon.http.process FD``, started by a run and by nobody else.

FD is its end of a socket pair. It ends when the other end is closed, however the run has ended, and
by nothing else: what a terminal or a service manager sends to all processes is for the run.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import sys

from abbe.daemon.http.cycles.hub import Hub
from abbe.daemon.http.serve import serve
from abbe.daemon.side_process.child import step_back, streams

_MEMORY = 1_000_000_000
"""Bytes of its own data: it fails before the correction's computer does."""
_LONGEST = 20_000_000


class JournalHandler(logging.Handler):
    """Hands what the server says to the run, for its journal."""

    def __init__(self, hub: Hub) -> None:
        super().__init__(logging.ERROR)
        self._hub = hub

    def emit(self, record: logging.LogRecord) -> None:
        """Hand one event on; of a failure its last line only."""
        text = record.getMessage().strip()
        if record.exc_info and record.exc_info[1] is not None:
            text = f"{text}: {record.exc_info[1]!r}"
        self._hub.log(record.levelno, text)


async def run(descriptor: int) -> None:
    """Serve until the run is over."""
    reader, writer = await streams(descriptor, _LONGEST)
    hub = Hub(reader, writer)
    try:
        setup = await hub.setup()
    except asyncio.IncompleteReadError:
        return
    logging.getLogger("uvicorn").addHandler(JournalHandler(hub))
    serving = asyncio.create_task(serve(hub, setup))
    beating = asyncio.create_task(hub.beat())
    taking = asyncio.create_task(hub.run())
    # the server never ends by itself, unless it fails
    await asyncio.wait({taking, serving}, return_when=asyncio.FIRST_COMPLETED)
    beating.cancel()
    if serving.done():
        serving.result()
    serving.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await serving


def main() -> None:
    """Begin."""
    step_back(_MEMORY)
    asyncio.run(run(int(sys.argv[1])))


if __name__ == "__main__":
    main()
