"""The feed of a running service to its HTTP process: what was asked for, between two cycles.

Nothing is worked out unless it was asked for, and nothing waits: a status is made at the end of a
cycle, cycles are packed while somebody streams them, and what the other side does not take in time
is dropped and counted.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from typing import Any

from pydantic import ValidationError

from abbe.compcore.errors import AbbeError
from abbe.compcore.validation import in_one_line
from abbe.daemon.control.controls import Controls
from abbe.daemon.control.requests import changes
from abbe.daemon.http.exchange.packing import CyclePacker
from abbe.daemon.http.exchange.wire import (
    MESSAGE,
    FeedFrame,
    ForJournal,
    Operation,
    Serving,
    WantCycles,
    WantStatus,
    packed,
    packed_cycles,
    packed_json,
)
from abbe.daemon.pipeline.cycle import Pipeline
from abbe.daemon.pipeline.record import CycleRecord, Listener

logger = logging.getLogger("abbe.http")

_STATUS_EVERY = 0.1
"""s between two statuses at least, however often they are asked for."""
_WITHOUT_A_CYCLE = 0.5
"""s after which a status is made although no cycle came to its end."""
_BATCH = 0.05
"""s for which cycles are gathered before they are sent."""
_WAITING = 1_000_000
"""Bytes that may wait for the HTTP process; what is more is dropped."""
_OPERATIONS = 16
"""Requests that may be under way at a time."""
_EVENTS_A_MINUTE = 20
_MESSAGES, _WINDOW = 50, 0.2
"""Messages in so many s that are read at once."""


class Feed:
    """One connection to the HTTP process.

    Parameters
    ----------
    pipeline
        Is listened to while something is asked for.
    controls
        Makes the status, and does what may be done.
    may_operate
        Whether anything may be changed over HTTP.

    Attributes
    ----------
    last_message_at
        When the other side said something last, monotonic, s; None before that.
    serving
        Whether it has said that it listens where it should.
    dropped
        Cycles that it did not take in time, in all.
    """

    def __init__(self, pipeline: Pipeline, controls: Controls, *, may_operate: bool) -> None:
        self._pipeline, self._controls = pipeline, controls
        self._may_operate = may_operate
        self._writer: asyncio.StreamWriter | None = None
        self._asked: asyncio.TimerHandle | None = None
        self._status_due = -math.inf
        self._every: float | None = None
        self._due = -math.inf
        self._pack = CyclePacker()
        self._batch: list[tuple[Any, ...]] = []
        self._flushing: asyncio.TimerHandle | None = None
        self._dropped = 0
        self._operations: set[asyncio.Task[None]] = set()
        self._events, self._events_since = 0, -math.inf
        self._messages, self._messages_since = 0, -math.inf
        self.last_message_at: float | None = None
        self.serving = False
        self.dropped = 0

    async def run(
        self,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        setup: dict[str, Any],
    ) -> None:
        """Serve until the other side is gone.

        Parameters
        ----------
        reader, writer
            The connection.
        setup
            What the other side has to do.
        """
        self._writer = writer
        self._send(packed_json(FeedFrame.SETUP, setup))
        try:
            while line := await reader.readline():
                self._take(line)
                await self._pace()
        except OSError:
            pass  # gone
        except ValueError as error:
            logger.warning("http: its process sends what is no request: %s", error)
        finally:
            self._writer = None
            writer.close()
            self._listen(self._on_cycle, wanted=False)
            self._listen(self._at_the_end_of_a_cycle, wanted=False)
            for timer in (self._asked, self._flushing):
                if timer is not None:
                    timer.cancel()
            for task in self._operations:
                task.cancel()

    async def _pace(self) -> None:
        """Read no faster than the other side has any reason to write."""
        now = time.monotonic()
        if now - self._messages_since > _WINDOW:
            self._messages, self._messages_since = 0, now
        self._messages += 1
        if self._messages > _MESSAGES:
            await asyncio.sleep(_WINDOW)

    def _take(self, line: bytes) -> None:
        try:
            message = MESSAGE.validate_json(line)
        except ValidationError as error:
            raise ValueError(in_one_line(error)) from None
        self.last_message_at = time.monotonic()
        if isinstance(message, WantStatus):
            self._want_status()
        elif isinstance(message, WantCycles):
            self._want_cycles(message.every)
        elif isinstance(message, Operation):
            self._take_on(message)
        elif isinstance(message, ForJournal):
            self._log(message)
        elif isinstance(message, Serving):
            self.serving = True

    def _listen(self, listener: Listener, *, wanted: bool) -> None:
        """Report every cycle, or no more: who is not listening costs the cycle nothing."""
        listeners = self._pipeline.listeners
        if wanted and listener not in listeners:
            listeners.append(listener)
        elif not wanted and listener in listeners:
            listeners.remove(listener)

    def _send(self, frame: bytes) -> bool:
        """Send now, or not at all."""
        writer = self._writer
        if writer is None or writer.transport.get_write_buffer_size() > _WAITING:
            return False
        writer.write(frame)
        return True

    def _want_status(self) -> None:
        if self._asked is not None:
            return
        loop = asyncio.get_running_loop()
        early = self._status_due - time.monotonic()
        if early > 0.0:
            self._asked = loop.call_later(early, self._want_status_now)
        else:
            self._want_status_now()

    def _want_status_now(self) -> None:
        self._listen(self._at_the_end_of_a_cycle, wanted=True)
        loop = asyncio.get_running_loop()
        self._asked = loop.call_later(_WITHOUT_A_CYCLE, self._send_status)

    def _at_the_end_of_a_cycle(self, _record: CycleRecord) -> None:
        self._listen(self._at_the_end_of_a_cycle, wanted=False)
        if self._asked is not None:
            self._asked.cancel()
        asyncio.get_running_loop().call_soon(self._send_status)

    def _send_status(self) -> None:
        self._asked = None
        self._listen(self._at_the_end_of_a_cycle, wanted=False)
        self._status_due = time.monotonic() + _STATUS_EVERY
        self._send(packed(FeedFrame.STATUS, self._controls.status_now().model_dump_json().encode()))

    def _want_cycles(self, every: float | None) -> None:
        self._every = every
        self._due = -math.inf
        self._pack.begin()
        self._listen(self._on_cycle, wanted=every is not None)

    def _on_cycle(self, record: CycleRecord) -> None:
        """Keep a cycle for the next batch, when it is time."""
        if record.time < self._due or self._every is None:
            return
        self._due = record.time + self._every
        self._batch.append(self._pack(record, self._dropped))
        self._dropped = 0
        if self._flushing is None:
            self._flushing = asyncio.get_running_loop().call_later(_BATCH, self._flush)

    def _flush(self) -> None:
        self._flushing = None
        batch, self._batch = self._batch, []
        if batch and not self._send(packed_cycles(batch)):
            # what comes next says how many are missing, those that were missing before included
            self._dropped += len(batch) + batch[0][-1]
            self.dropped += len(batch)
            self._pack.begin()

    def _take_on(self, operation: Operation) -> None:
        if len(self._operations) >= _OPERATIONS:
            self._answer(operation, {"ok": False, "error": "busy: ask again later"})
            return
        task = asyncio.create_task(self._do(operation))
        self._operations.add(task)
        task.add_done_callback(self._operations.discard)

    async def _do(self, operation: Operation) -> None:
        request = operation.request
        if changes(request) and not self._may_operate:
            error = "nobody can change what runs: its configuration has no [control]"
            self._answer(operation, {"ok": False, "error": error})
            return
        try:
            done = await self._controls(request, operation.who)
        except AbbeError as error:
            logger.warning("http: refused, asked by %s: %s", operation.who, error)
            self._answer(operation, {"ok": False, "error": str(error)})
        except Exception as error:
            logger.exception("http: a request failed; the correction goes on")
            self._answer(operation, {"ok": False, "error": f"failed: {error}"})
        else:
            self._answer(operation, {"ok": True, **done})

    def _answer(self, operation: Operation, answer: dict[str, Any]) -> None:
        self._send(packed_json(FeedFrame.ANSWER, {"number": operation.number, "answer": answer}))

    def _log(self, event: ForJournal) -> None:
        """Hand something on to the journal; not more than some a minute."""
        now = time.monotonic()
        if now - self._events_since > 60.0:
            self._events, self._events_since = 0, now
        self._events += 1
        if self._events <= _EVENTS_A_MINUTE:
            text = "".join(c if c.isprintable() else " " for c in event.text)
            logger.log(event.level, "http: %s", text)
