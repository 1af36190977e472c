"""The process that uploads, started by a run only.

``python -m abbe.daemon.fleet.uploading.process FD``: FD is its end of a socket pair: a line of
JSON for each status. It ends when the other end is closed, however the run has ended, and by
nothing else.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
import threading
from typing import Any

from abbe.daemon.fleet.uploading.uploader import Uploader
from abbe.daemon.side_process.child import step_back, streams

_MEMORY = 600_000_000
"""Bytes of its own data: campaigns are held whole while they go up."""
_LONGEST = 4_000_000
"""Bytes of a status."""
_BEAT = 5.0
"""s between two words to the run, at most."""
_LAST = 1.5
"""s for what is under way when the run is over."""


async def run(descriptor: int) -> None:
    """Upload until the run is over."""
    reader, writer = await streams(descriptor, _LONGEST)
    first = await reader.readline()
    if not first:
        return
    loop = asyncio.get_running_loop()

    def tell(what: dict[str, Any]) -> None:
        if not writer.is_closing():
            writer.write(json.dumps(what).encode("ascii") + b"\n")

    def say(level: int, text: str) -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed: the run is over
            loop.call_soon_threadsafe(tell, {"level": level, "text": text[:1000]})

    async def beat() -> None:
        while True:
            tell({})
            await asyncio.sleep(_BEAT)

    uploader = Uploader(json.loads(first), say)
    ending = threading.Event()
    failed: list[BaseException] = []

    def upload() -> None:
        try:
            uploader.run(ending)
        except BaseException as error:  # noqa: BLE001  (raised again, by the process)
            failed.append(error)
            with contextlib.suppress(RuntimeError):
                loop.call_soon_threadsafe(reader.feed_eof)

    # a store that does not answer must not keep the process: a thread that ends with it
    thread = threading.Thread(target=upload, name="upload", daemon=True)
    thread.start()
    beating = asyncio.create_task(beat())
    with contextlib.suppress(OSError):
        while line := await reader.readline():
            uploader.take(json.loads(line))
    beating.cancel()
    ending.set()
    await asyncio.to_thread(thread.join, _LAST)
    if failed:
        raise failed[0]


def main() -> None:
    """Begin."""
    step_back(_MEMORY)
    asyncio.run(run(int(sys.argv[1])))


if __name__ == "__main__":
    main()
