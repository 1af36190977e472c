"""A process beside a run, as the run sees it: started, watched, started anew; never waited for."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import sys
import time
from collections.abc import Callable
from typing import Protocol

_FIRST_DELAY, _LONGEST_DELAY = 1.0, 60.0
"""s before it is started anew: doubled each time, until it has served for that long."""
_SILENT = 30.0
"""s without a word after which it counts as hanging."""
_STARTS = 60.0
"""s until its first word."""
_GRACE = 2.0
"""s that it is given to end."""
_SAID = 20
"""Lines of its standard error that go into the journal."""


class Talk(Protocol):
    """What is said to one such process while it runs."""

    @property
    def last_message_at(self) -> float | None:
        """When it said something last, monotonic, s; None before that."""

    async def run(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Talk until it is gone."""


class SideProcess:
    """Keeps a process running while `run` runs.

    Parameters
    ----------
    name
        As the journal calls it.
    module
        That is run, with the number of its socket's descriptor.
    talk
        Makes what is said to each process begun.
    longest
        Bytes of a line that it may say.
    """

    def __init__(self, name: str, module: str, talk: Callable[[], Talk], longest: int) -> None:
        self._name, self._module, self._talk, self._longest = name, module, talk, longest
        self._logger = logging.getLogger(f"abbe.{name}")

    async def run(self) -> None:
        """Until cancelled; whatever happens to the process, the correction goes on."""
        delay = _FIRST_DELAY
        while True:
            began = time.monotonic()
            try:
                why = await self._once()
            except OSError as error:
                why = f"cannot be started: {error.strerror}"
            if time.monotonic() - began > _LONGEST_DELAY:
                delay = _FIRST_DELAY
            self._logger.warning("%s: its process %s; begun anew in %g s", self._name, why, delay)
            await asyncio.sleep(delay)
            delay = min(2.0 * delay, _LONGEST_DELAY)

    async def _once(self) -> str:
        """Run it once; why it ended."""
        began = time.monotonic()
        mine, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                self._module,
                str(its.fileno()),
                pass_fds=(its.fileno(),),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.PIPE,
                # what a terminal sends ends the run, which then ends this
                start_new_session=True,
            )
        except BaseException:
            mine.close()
            raise
        finally:
            its.close()
        mine.setblocking(False)
        reader, writer = await asyncio.open_unix_connection(sock=mine, limit=self._longest)
        talk = self._talk()
        serving = asyncio.create_task(talk.run(reader, writer))
        saying = asyncio.create_task(self._say(process))
        ended = asyncio.create_task(process.wait())
        try:
            while not ended.done():
                await asyncio.wait({ended}, timeout=1.0)
                if serving.done() and not ended.done():
                    await asyncio.wait({ended}, timeout=_GRACE)
                    if not ended.done():
                        return "is let go"
                limit = _STARTS if talk.last_message_at is None else _SILENT
                silent = time.monotonic() - (talk.last_message_at or began)
                if not ended.done() and silent > limit:
                    return f"says nothing for {limit:g} s and is ended"
            return f"has ended (exit status {process.returncode})"
        finally:
            # its end of the connection is closed: that is its sign to end
            writer.close()
            serving.cancel()
            with contextlib.suppress(TimeoutError, asyncio.CancelledError):
                async with asyncio.timeout(_GRACE):
                    await asyncio.shield(ended)
            if process.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    process.kill()
            with contextlib.suppress(TimeoutError, asyncio.CancelledError):
                async with asyncio.timeout(_GRACE):
                    await asyncio.gather(saying, ended)

    async def _say(self, process: asyncio.subprocess.Process) -> None:
        """What it says on standard error goes into the journal, as far as it is not too much."""
        if process.stderr is None:
            return
        said = 0
        with contextlib.suppress(ValueError, OSError):
            while line := await process.stderr.readline():
                said += 1
                if said <= _SAID:
                    text = line.decode("utf-8", "replace").rstrip()
                    plain = "".join(c if c.isprintable() else " " for c in text)
                    self._logger.warning("%s: %s", self._name, plain)
