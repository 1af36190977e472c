"""The HTTP process as its run sees it: what it has to do, and what is said to it."""

from __future__ import annotations

import asyncio
import os
from typing import Any

from abbe.daemon.config.sections.http import HttpSetup
from abbe.daemon.control.controls import Controls
from abbe.daemon.guard import DIRECTIONS
from abbe.daemon.http.exchange.feed import Feed
from abbe.daemon.http.exchange.wire import LONGEST_MESSAGE
from abbe.daemon.side_process.parent import SideProcess
from abbe.daemon.status.status_source import ObservedService


class _FeedTalk:
    """One connection to it."""

    def __init__(self, feed: Feed, task: dict[str, Any]) -> None:
        self._feed, self._task = feed, task

    @property
    def last_message_at(self) -> float | None:
        """When it said something last, monotonic, s; None before that."""
        return self._feed.last_message_at

    async def run(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Feed it until it is gone."""
        await self._feed.run(reader, writer, self._task)


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
        module = "abbe.daemon.http.process"
        await SideProcess("http", module, self._talk, LONGEST_MESSAGE).run()

    def _talk(self) -> _FeedTalk:
        may_operate = self._service.configuration.file.control is not None
        feed = Feed(self._service.pipeline, self._controls, may_operate=may_operate)
        return _FeedTalk(feed, self._task())

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
