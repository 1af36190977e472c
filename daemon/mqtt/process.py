"""The process that publishes: ``python -m abbe.daemon.mqtt.process FD``, started by a run only.

FD is its end of a socket pair: a line of JSON for each status and event. It ends when the other end
is closed, however the run has ended, and by nothing else.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import json
import os
import sys
from pathlib import Path
from typing import Any

from abbe.daemon.mqtt.connection import BrokerConnection
from abbe.daemon.mqtt.spool import Spool
from abbe.daemon.side_process.child import step_back, streams

_MEMORY = 400_000_000
"""Bytes of its own data."""
_LONGEST = 4_000_000
"""Bytes of a status."""
_BEAT = 5.0
"""s between two words to the run, at most."""
_LAST = 1.5
"""s for what still waits when the run is over."""
_AGAIN = 2.0
"""s until a file that another run uses is tried again."""


class Forwarder:
    """Hands what the run says on, and says how it goes.

    Parameters
    ----------
    writer
        To the run.
    """

    def __init__(self, writer: asyncio.StreamWriter) -> None:
        self._writer = writer
        self.connection: BrokerConnection | None = None
        self._dropped = 0

    def say(self, level: int, text: str) -> None:
        """Have a sentence written into the run's journal."""
        self._tell({"level": level, "text": text[:1000]})

    def take(self, said: dict[str, Any]) -> None:
        """Take one line of the run's."""
        if self.connection is None:
            return
        self._dropped += said.get("dropped", 0)
        if "event" in said:
            self.connection.put_event(said["event"])
        if "status" in said:
            self.connection.put_status(said["status"], self._dropped)

    async def beat(self) -> None:
        """Say now and then that all is well."""
        while True:
            self._tell({})
            await asyncio.sleep(_BEAT)

    def _tell(self, what: dict[str, Any]) -> None:
        self._writer.write(json.dumps(what).encode("ascii") + b"\n")


async def run(descriptor: int) -> None:
    """Publish until the run is over."""
    reader, writer = await streams(descriptor, _LONGEST)
    first = await reader.readline()
    if not first:
        return
    task = json.loads(first)
    outgoing = Forwarder(writer)
    beating = asyncio.create_task(outgoing.beat())
    taking = asyncio.create_task(_take(reader, outgoing))
    with contextlib.ExitStack() as stack:
        if not await _alone(Path(task["buffer"]), stack, outgoing, taking):
            return
        spool = Spool(Path(task["buffer"]), task["max_bytes"], lambda text: outgoing.say(30, text))
        stack.callback(spool.close)
        publisher = _format(task["format"])(task, spool, task["about"], outgoing.say)
        outgoing.connection = publisher
        publishing = asyncio.create_task(publisher.run())
        await asyncio.wait({taking, publishing}, return_when=asyncio.FIRST_COMPLETED)
        if not publishing.done():
            publisher.end()
            await asyncio.wait({publishing}, timeout=_LAST)
        for one in (beating, taking, publishing):
            one.cancel()
        await asyncio.wait({publishing}, timeout=_LAST)
        if publishing.done() and not publishing.cancelled():
            publishing.result()


def _format(name: str) -> type[BrokerConnection]:
    """What speaks to the broker; of the other format not even the packages are loaded."""
    if name == "sparkplug":
        from abbe.daemon.mqtt.sparkplug.node import SparkplugNode

        return SparkplugNode
    from abbe.daemon.mqtt.publisher import Publisher

    return Publisher


async def _take(reader: asyncio.StreamReader, outgoing: Forwarder) -> None:
    with contextlib.suppress(OSError):
        while line := await reader.readline():
            outgoing.take(json.loads(line))


async def _alone(
    buffer: Path, stack: contextlib.ExitStack, outgoing: Forwarder, over: asyncio.Task[None]
) -> bool:
    """Wait until no other run uses the file of what waits; False: the run is over before."""
    said = False
    buffer.parent.mkdir(parents=True, exist_ok=True)
    lock = os.open(f"{buffer}.lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    stack.callback(os.close, lock)
    while not over.done():
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            if not said:
                outgoing.say(30, f"another run publishes from {buffer}; this one waits")
            said = True
            await asyncio.wait({over}, timeout=_AGAIN)
        else:
            return True
    return False


def main() -> None:
    """Begin."""
    step_back(_MEMORY)
    asyncio.run(run(int(sys.argv[1])))


if __name__ == "__main__":
    main()
