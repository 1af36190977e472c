"""The process that serves: ``python -m abbe.daemon.opcua_server.process FD``, begun by a run.

FD is its end of a socket pair: a line of JSON for each status and event. It ends when the other end
is closed, however the run has ended.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
import time
from typing import Any

from abbe.daemon.opcua_server.serving import make_server, start
from abbe.daemon.opcua_server.space import MachineSpace
from abbe.daemon.opcua_server.values import of_status
from abbe.daemon.side_process.child import step_back, streams

_MEMORY = 400_000_000
"""Bytes of its own data."""
_LONGEST = 4_000_000
"""Bytes of a status."""
_BEAT = 5.0
"""s between two words to the run, at most."""
_AGAIN = 5.0
"""s until an address that somebody else has is tried again."""
_SILENT = 3.0
"""Times that a status is late before the run counts as silent; and s besides."""


class OfferedRun:
    """What the run says, shown; and what there is to say to the run.

    Parameters
    ----------
    writer
        To the run.
    task
        As the run gave it.
    """

    def __init__(self, writer: asyncio.StreamWriter, task: dict[str, Any]) -> None:
        self._writer, self._task = writer, task
        self._heard = time.monotonic()

    async def beat(self) -> None:
        """Say now and then that all is well."""
        while True:
            self._tell({})
            await asyncio.sleep(_BEAT)

    def say(self, level: int, text: str) -> None:
        """Have a sentence written into the run's journal."""
        self._tell({"level": level, "text": text[:1000]})

    def _tell(self, what: dict[str, Any]) -> None:
        self._writer.write(json.dumps(what).encode("ascii") + b"\n")

    async def show(self, reader: asyncio.StreamReader, space: MachineSpace) -> None:
        """Show what the run says, until it says no more."""
        with contextlib.suppress(OSError):
            while line := await reader.readline():
                said = json.loads(line)
                if "event" in said:
                    await space.tell(said["event"])
                if "status" in said:
                    self._heard = time.monotonic()
                    await space.show(of_status(said["status"]))

    async def watch(self, space: MachineSpace) -> None:
        """See when the run says nothing any more though it is there."""
        while True:
            await asyncio.sleep(0.5)
            if time.monotonic() - self._heard > _SILENT * (self._task["every"] + 1.0):
                await space.fall_silent()

    async def listen(self, server: Any) -> None:
        """Begin to listen; an address that is somebody else's is waited for."""
        said = False
        place = f"{self._task['host']}:{self._task['port']}"
        while True:
            try:
                await start(server, self._task)
            except OSError as error:
                if not said:
                    self.say(30, f"{place} cannot be listened at: {error.strerror}; tried again")
                said = True
                await asyncio.sleep(_AGAIN)
            else:
                self.say(20, f"listens at {place}")
                return


async def run(descriptor: int) -> None:
    """Serve until the run is over."""
    reader, writer = await streams(descriptor, _LONGEST)
    first = await reader.readline()
    if not first:
        return
    task = json.loads(first)
    serving = OfferedRun(writer, task)
    beating = asyncio.create_task(serving.beat())
    server = await make_server(task, task["about"])
    space = MachineSpace(server, task["about"]["machine"])
    await space.make()
    tasks = {
        asyncio.create_task(serving.watch(space)),
        asyncio.create_task(serving.listen(server)),
        beating,
    }
    showing = asyncio.create_task(serving.show(reader, space))
    await showing
    for one in tasks:
        one.cancel()
    with contextlib.suppress(Exception):
        async with asyncio.timeout(1.0):
            await server.stop()
    writer.close()


def main() -> None:
    """Begin."""
    step_back(_MEMORY)
    asyncio.run(run(int(sys.argv[1])))


if __name__ == "__main__":
    main()
