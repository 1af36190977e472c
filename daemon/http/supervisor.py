"""The HTTP process as its run sees it: started, watched, started anew; never waited for."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
import sys
import time
from typing import Any

from abbe.daemon.config.sections.http import HttpSetup
from abbe.daemon.control.controls import Controls
from abbe.daemon.guard import DIRECTIONS
from abbe.daemon.http.exchange.feed import Feed
from abbe.daemon.http.exchange.wire import LONGEST_MESSAGE
from abbe.daemon.status.status_source import ObservedService

logger = logging.getLogger("abbe.http")

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


class HttpProcess:
    """Keeps the HTTP process running while `run` runs.

    Parameters
    ----------
    service
        What runs.
    controls
        Make the status, and do what may be done.
    setup
        Where it listens, and who may ask.
    """

    def __init__(self, service: ObservedService, controls: Controls, setup: HttpSetup) -> None:
        self._service, self._controls, self._setup = service, controls, setup

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
            logger.warning("http: its process %s; begun anew in %g s", why, delay)
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
                "abbe.daemon.http.process",
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
        reader, writer = await asyncio.open_unix_connection(sock=mine, limit=LONGEST_MESSAGE)
        may_operate = self._service.configuration.file.control is not None
        feed = Feed(self._service.pipeline, self._controls, may_operate=may_operate)
        serving = asyncio.create_task(feed.run(reader, writer, self._task()))
        saying = asyncio.create_task(_say(process))
        ended = asyncio.create_task(process.wait())
        try:
            while not ended.done():
                await asyncio.wait({ended}, timeout=1.0)
                if serving.done() and not ended.done():
                    await asyncio.wait({ended}, timeout=_GRACE)
                    if not ended.done():
                        return "is let go"
                limit = _STARTS if feed.last_message_at is None else _SILENT
                silent = time.monotonic() - (feed.last_message_at or began)
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

    def _task(self) -> dict[str, Any]:
        """What it has to do, and what a cycle's numbers mean."""
        service, setup = self._service, self._setup
        pipeline, model = service.pipeline, service.configuration.model
        return {
            "socket": str(setup.socket),
            "listen": [list(place) for place in setup.listen],
            "tokens": str(setup.tokens),
            "certificate": None if setup.certificate is None else str(setup.certificate),
            "key": None if setup.key is None else str(setup.key),
            "clients": list(setup.clients),
            "machine": model.machine.name,
            "version": service.identity.version,
            "pid": os.getpid(),
            "axes": list(pipeline.axes),
            "corrected_axes": list(pipeline.corrected_axes),
            "directions": [*DIRECTIONS, *pipeline.directions[len(DIRECTIONS) :]],
            "rotary": [axis for axis in pipeline.axes if model.machine.axes[axis].rotary],
        }


async def _say(process: asyncio.subprocess.Process) -> None:
    """What it says on standard error goes into the journal, as far as it is not too much."""
    if process.stderr is None:
        return
    said = 0
    with contextlib.suppress(ValueError, OSError):
        while line := await process.stderr.readline():
            said += 1
            if said <= _SAID:
                text = line.decode("utf-8", "replace").rstrip()
                logger.warning("http: %s", "".join(c if c.isprintable() else " " for c in text))
