"""A process that is told what a run says: statuses and events handed over, and never waited for."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import socket
import time
from collections import deque
from datetime import UTC, datetime
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from abbe.daemon.control.controls import Controls
from abbe.daemon.pipeline.record import CycleRecord
from abbe.daemon.side_process.parent import SideProcess
from abbe.daemon.status.status_source import ObservedService

_SOONEST = 0.2
"""s between two statuses, however often the status word changes."""
_WITHOUT_A_CYCLE = 0.5
"""s after which a status is made although no cycle comes to its end."""
_WAITING = 1_000_000
"""Bytes that may wait for the process; what is more is dropped."""
_EVENTS = 1000
"""Events that may wait for the process to begin."""
_LONGEST = 10_000
"""Bytes of a line of the process's, and characters of an event."""
_A_MINUTE = 20
"""Sentences of the process's that go into the journal."""


class ToldProcess:
    """Keeps a process that is told everything running while `run` runs.

    Parameters
    ----------
    name
        As the journal calls it; its own events are not told to it.
    module
        That is run.
    service
        What runs.
    controls
        Make the status.
    task
        What the process has to know, as JSON takes it.
    every
        s from one status to the next; a change of the status word does not wait.
    """

    def __init__(
        self,
        name: str,
        module: str,
        service: ObservedService,
        controls: Controls,
        task: dict[str, Any],
        every: float,
    ) -> None:
        self._name, self._module, self._every = name, module, every
        self._service, self._controls, self._task = service, controls, task
        self._events = _JournalEvents(f"abbe.{name}")

    async def run(self) -> None:
        """Until cancelled; whatever happens to the process, the correction goes on."""
        journal = logging.getLogger("abbe")
        self._events.begin()
        journal.addHandler(self._events)
        try:
            await SideProcess(self._name, self._module, self._talk, _LONGEST).run()
        finally:
            journal.removeHandler(self._events)

    def _talk(self) -> _TellingTalk:
        service = self._service
        about = {
            "abbe": service.identity.version,
            "machine": service.configuration.model.machine.name,
            "host": socket.gethostname(),
            "pid": os.getpid(),
        }
        task = {**self._task, "about": about}
        return _TellingTalk(self._name, service, self._controls, self._events, task, self._every)


class _JournalEvents(logging.Handler):
    """The journal's events, until somebody takes them; its own are none."""

    def __init__(self, own: str) -> None:
        super().__init__(logging.INFO)
        self._own = own
        self._loop: asyncio.AbstractEventLoop | None = None
        self._waiting: deque[dict[str, Any]] = deque()
        self.news = asyncio.Event()
        self.lost = 0

    def begin(self) -> None:
        """Take events of all threads from now on, for this loop."""
        self._loop = asyncio.get_running_loop()

    def emit(self, record: logging.LogRecord) -> None:
        """Take one event, of any thread."""
        if record.name.startswith(self._own) or self._loop is None:
            return
        try:
            text = record.getMessage()
        except Exception:  # noqa: BLE001 - as logging's own handlers: the event is at fault
            self.handleError(record)
            return
        event = {
            "at": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname,
            "part": record.name,
            "text": text[:_LONGEST],
        }
        with contextlib.suppress(RuntimeError):  # the loop is closed: the run is over
            self._loop.call_soon_threadsafe(self._keep, event)

    def _keep(self, event: dict[str, Any]) -> None:
        if len(self._waiting) >= _EVENTS:
            self._waiting.popleft()
            self.lost += 1
        self._waiting.append(event)
        self.news.set()

    def taken(self) -> list[dict[str, Any]]:
        """Those that wait, which then wait no more."""
        self.news.clear()
        found = list(self._waiting)
        self._waiting.clear()
        return found


class _ProcessLine(BaseModel):
    """One line of the process's."""

    model_config = ConfigDict(extra="forbid")
    level: Annotated[int, Field(ge=0, le=50)] = 0
    text: str = ""


class _TellingTalk:
    """One connection to the process."""

    def __init__(
        self,
        name: str,
        service: ObservedService,
        controls: Controls,
        events: _JournalEvents,
        task: dict[str, Any],
        every: float,
    ) -> None:
        self._name, self._logger = name, logging.getLogger(f"abbe.{name}")
        self._service, self._controls, self._events = service, controls, events
        self._task, self._every = task, every
        self._word = -1
        self._due, self._between = asyncio.Event(), asyncio.Event()
        self._dropped = 0
        self._failed = False
        self._said, self._said_since = 0, 0.0
        self.last_message_at: float | None = None

    async def run(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Hand over what is to be published until the process is gone."""
        listeners = self._service.pipeline.listeners
        writer.write(json.dumps(self._task).encode("ascii") + b"\n")
        listeners.append(self._on_cycle)
        tasks = [
            asyncio.create_task(self._hand_over_statuses(writer)),
            asyncio.create_task(self._hand_over_events(writer)),
        ]
        try:
            while line := await reader.readline():
                self._take(line)
        except (OSError, ValueError):
            pass  # gone, or a stranger
        finally:
            listeners.remove(self._on_cycle)
            for task in tasks:
                task.cancel()
            writer.close()

    def _take(self, line: bytes) -> None:
        try:
            said = _ProcessLine.model_validate_json(line)
        except ValidationError:
            raise ValueError("not a line of such a process") from None
        now = self.last_message_at = time.monotonic()
        if not said.text:
            return
        if now - self._said_since > 60.0:
            self._said, self._said_since = 0, now
        self._said += 1
        if self._said <= _A_MINUTE:
            text = "".join(c if c.isprintable() else " " for c in said.text)
            self._logger.log(said.level or logging.INFO, "%s: %s", self._name, text)

    def _on_cycle(self, record: CycleRecord) -> None:
        """The end of a cycle: it may be time for a status, and is when the status word changes."""
        self._between.set()
        if record.status != self._word:
            self._word = record.status
            self._due.set()

    async def _hand_over_statuses(self, writer: asyncio.StreamWriter) -> None:
        while True:
            # between two cycles, so that none waits for it; where none ends, the status says so
            self._between.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_WITHOUT_A_CYCLE):
                    await self._between.wait()
            self._due.clear()
            try:
                status = self._controls.status_now().model_dump_json().encode()
            except Exception as error:
                if not self._failed:
                    self._logger.exception("%s: no status can be made: %s", self._name, error)
                self._failed = True
            else:
                # it is JSON already: it is put into the line as it is
                self._send_line(writer, b'{"status": %s' % status)
            await asyncio.sleep(_SOONEST)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(max(0.0, self._every - _SOONEST)):
                    await self._due.wait()

    async def _hand_over_events(self, writer: asyncio.StreamWriter) -> None:
        while True:
            for event in self._events.taken():
                self._send(writer, {"event": event})
            await self._events.news.wait()

    def _send(self, writer: asyncio.StreamWriter, what: dict[str, Any]) -> None:
        self._send_line(writer, json.dumps(what).encode("ascii")[:-1])

    def _send_line(self, writer: asyncio.StreamWriter, begun: bytes) -> None:
        """Send an object that lacks its end, with what was dropped before; or drop it."""
        if writer.transport.get_write_buffer_size() > _WAITING:
            self._dropped += 1
            return
        dropped = self._dropped + self._events.lost
        self._dropped = self._events.lost = 0
        end = b', "dropped": %d}\n' % dropped if dropped else b"}\n"
        writer.write(begun + end)
