"""Following a run while somebody looks: its status, its cycles, and since when it is lost.

Whoever does not read gets the newest of each kind when he reads again, and nothing in between.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from abbe.compcore.errors import AbbeError
from abbe.daemon.status.run_status import RunStatus
from abbe.daemon.workbench.live.cycles import streamed_cycles
from abbe.daemon.workbench.live.present import PresentRun
from abbe.daemon.workbench.live.shown import moved, shown_run

_EVERY = 1.0
"""s from one status to the next where cycles are streamed."""
_WITHOUT_STREAM = 0.4
"""s likewise where they are not."""
_CYCLES = 0.1
"""s from one cycle to the next."""


class NewestEvents:
    """What one browser has not read yet: the newest of each kind."""

    def __init__(self) -> None:
        self._waiting: dict[str, bytes] = {}
        self._something = asyncio.Event()

    def put(self, kind: str, data: bytes) -> None:
        """Take an event in; one of its kind that was not read is forgotten."""
        self._waiting.pop(kind, None)
        self._waiting[kind] = data
        self._something.set()

    async def take(self, within: float) -> dict[str, bytes]:
        """All that waits, oldest first; empty when nothing comes within so many s."""
        if not self._waiting:
            self._something.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(within):
                    await self._something.wait()
        taken, self._waiting = self._waiting, {}
        return taken


class LiveFollower:
    """Asks a run while at least one browser listens, and tells all of them.

    Parameters
    ----------
    present
        The run.
    """

    def __init__(self, present: PresentRun) -> None:
        self._present = present
        self._browsers: set[NewestEvents] = set()
        self._task: asyncio.Task[None] | None = None
        self._status: RunStatus | None = None
        self._known: dict[str, bytes] = {}
        self._last = ""
        self.ended = False
        """Whether nothing comes any more: the server ends."""

    def end(self) -> None:
        """Tell nobody anything any more, so that streams end by themselves."""
        self.ended = True
        for browser in self._browsers:
            browser.put("end", b"")

    @contextlib.contextmanager
    def stream(self) -> Iterator[NewestEvents]:
        """The events for one browser while the context lasts."""
        events = NewestEvents()
        for kind, data in self._known.items():
            events.put(kind, data)
        self._browsers.add(events)
        if self._task is None:
            self._task = asyncio.create_task(self._follow())
        try:
            yield events
        finally:
            self._browsers.discard(events)
            if not self._browsers and self._task is not None:
                self._task.cancel()
                self._task = None
                self._known = {}

    async def _follow(self) -> None:
        cycles: asyncio.Task[None] | None = None
        try:
            while True:
                streamed = cycles is not None and not cycles.done()
                try:
                    status, found = await asyncio.to_thread(self._look)
                except AbbeError as error:
                    self._lose(str(error))
                else:
                    self._find(status, found)
                    socket = self._present.stream
                    if socket is not None and not streamed:
                        cycles = asyncio.create_task(self._stream(socket))
                await asyncio.sleep(_EVERY if streamed else _WITHOUT_STREAM)
        finally:
            if cycles is not None:
                cycles.cancel()

    async def _stream(self, socket: Path) -> None:
        with contextlib.suppress(OSError):
            async for cycle in streamed_cycles(socket, _CYCLES):
                if self._status is not None:
                    self._tell("cycle", moved(self._status, cycle))

    def _look(self) -> tuple[RunStatus, dict[str, Any]]:
        status = self._present.status()
        return status, shown_run(status, self._present.model_or_none)

    def _find(self, status: RunStatus, found: Mapping[str, Any]) -> None:
        self._status = status
        self._last = str(found["at"])
        self._known.pop("lost", None)
        self._tell("run", found)

    def _lose(self, why: str) -> None:
        self._status = None
        if not self._last:
            self._last = datetime.now().astimezone().isoformat(timespec="milliseconds")
        self._known.pop("cycle", None)
        self._tell("lost", {"since": self._last, "why": why})

    def _tell(self, kind: str, content: Mapping[str, Any]) -> None:
        data = json.dumps(content, ensure_ascii=False, separators=(",", ":")).encode()
        self._known[kind] = data
        for browser in self._browsers:
            browser.put(kind, data)
