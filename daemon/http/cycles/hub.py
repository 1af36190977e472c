"""The hub of the HTTP process: what the run sends, handed to all who ask; nobody waits for another.

One status is asked for at a time, whoever wants it, and serves all who ask within its time. A cycle
is put into words once for all who stream it. Each of them has a queue of his own that is bounded:
whoever does not read loses cycles, and learns how many.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import time
from collections import deque
from typing import Any

from abbe.daemon.control.requests import Request
from abbe.daemon.http.cycles.cycle_event import CycleEvents
from abbe.daemon.http.exchange.wire import (
    Alive,
    FeedFrame,
    ForJournal,
    Message,
    Operation,
    WantCycles,
    WantStatus,
    next_frame,
    unpacked_cycles,
)

_GOOD_FOR = 0.2
"""s for which a status serves those who ask."""
_STATUS_WITHIN = 2.0
"""s in which the run has to say something."""
_ANSWER_WITHIN = 30.0
"""s for an operation: a model is folded anew."""
OVER = "the run is over"
"""What is said to who asks then."""
_QUEUE = 256
"""Cycles that wait for one client."""


class SilentRunError(Exception):
    """The run says nothing: it hangs, or has ended."""


class Subscription:
    """One client's stream of cycles.

    Parameters
    ----------
    every
        s from one cycle to the next; 0: every one.

    Attributes
    ----------
    dropped
        Cycles that he has lost in all.
    """

    def __init__(self, every: float) -> None:
        self.every = every
        self.dropped = 0
        self._waiting: deque[tuple[int, bytes]] = deque()
        self._lost = 0
        self._due = 0.0
        self._something = asyncio.Event()

    def put(self, time: float, number: int, event: bytes, dropped: int) -> None:
        """Take one cycle in, when it is time; the oldest goes when there is no room."""
        self._lost += dropped
        self.dropped += dropped
        if time < self._due:
            return
        self._due = time + self.every - 1e-4
        if len(self._waiting) >= _QUEUE:
            self._waiting.popleft()
            self._lost += 1
            self.dropped += 1
        self._waiting.append((number, event))
        self._something.set()

    def wake(self) -> None:
        """Whoever waits for a cycle waits no longer."""
        self._something.set()

    async def take(self, within: float) -> tuple[list[tuple[int, bytes]], int]:
        """All that waits, and how many are missing since the last call; empty when nothing comes.

        Parameters
        ----------
        within
            s to wait for the first.
        """
        if not self._waiting:
            self._something.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(within):
                    await self._something.wait()
        taken, lost = list(self._waiting), self._lost
        self._waiting.clear()
        self._lost = 0
        return taken, lost


class Hub:
    """The connection to the run.

    Parameters
    ----------
    reader, writer
        The connection.

    Attributes
    ----------
    dropped
        Cycles that were lost, of all clients together.
    ended
        Whether the run is over.
    """

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer
        self._status: bytes = b""
        self._status_at = -1e9
        self._asked: asyncio.Future[bytes] | None = None
        self._asked_at = -1e9
        self._answers: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._numbers = itertools.count()
        self._subscriptions: set[Subscription] = set()
        self._every: float | None = None
        self._events: CycleEvents | None = None
        self.dropped = 0
        self.ended = False

    async def setup(self) -> dict[str, Any]:
        """What the run wants of this process: its first frame."""
        kind, content = await next_frame(self._reader)
        if kind is not FeedFrame.SETUP:
            raise ValueError("the run begins with something else than what is to be done")
        found: dict[str, Any] = json.loads(content)
        self._events = CycleEvents(found)
        return found

    async def run(self) -> None:
        """Take in what the run sends, until it is over."""
        try:
            while True:
                self._take(*await next_frame(self._reader))
        except (asyncio.IncompleteReadError, ConnectionError):
            self.ended = True
            for subscription in self._subscriptions:
                subscription.wake()
            for waiting in (self._asked, *self._answers.values()):
                if waiting is not None and not waiting.done():
                    waiting.set_exception(SilentRunError(OVER))
                    waiting.exception()  # nobody may wait for it any more

    def _take(self, kind: FeedFrame, content: bytes) -> None:
        if kind is FeedFrame.STATUS:
            self._status, self._status_at = content, time.monotonic()
            if self._asked is not None and not self._asked.done():
                self._asked.set_result(content)
            self._asked = None
        elif kind is FeedFrame.CYCLES and self._events is not None:
            for cycle in unpacked_cycles(content):
                event = self._events(cycle)
                for subscription in self._subscriptions:
                    before = subscription.dropped
                    subscription.put(cycle.time, cycle.number, event, cycle.dropped)
                    self.dropped += subscription.dropped - before
        elif kind is FeedFrame.ANSWER:
            found = json.loads(content)
            waiting = self._answers.pop(found["number"], None)
            if waiting is not None and not waiting.done():
                waiting.set_result(found["answer"])

    def say(self, message: Message) -> None:
        """Tell the run something; what it does not take is not kept."""
        if not self._writer.is_closing() and self._writer.transport.get_write_buffer_size() < 1e6:
            self._writer.write(message.model_dump_json().encode() + b"\n")

    async def beat(self, every: float = 2.0) -> None:
        """Say that this process goes round, until cancelled."""
        while True:
            self.say(Alive())
            await asyncio.sleep(every)

    def log(self, level: int, text: str) -> None:
        """Something for the run's journal."""
        self.say(ForJournal(level=level, text=text[:4000]))

    async def status(self) -> bytes:
        """A `RunStatus` as JSON, not older than some tenths of a second.

        Raises
        ------
        SilentRunError
            When the run does not answer.
        """
        if time.monotonic() - self._status_at < _GOOD_FOR:
            return self._status
        if self.ended:
            raise SilentRunError(OVER)
        now = time.monotonic()
        # one answer for all who wait, however late it comes: the end of the run has to find them
        if self._asked is None:
            self._asked = asyncio.get_running_loop().create_future()
            self._asked_at = -1e9
        if now - self._asked_at > _STATUS_WITHIN:
            self._asked_at = now
            self.say(WantStatus())
        try:
            async with asyncio.timeout(_STATUS_WITHIN):
                return await asyncio.shield(self._asked)
        except TimeoutError:
            raise SilentRunError(f"the run has not answered within {_STATUS_WITHIN:g} s") from None

    async def do(self, request: Request, who: str) -> dict[str, Any]:
        """Have the run do something; its answer.

        Raises
        ------
        SilentRunError
            When it does not answer; nobody knows then whether it was done.
        """
        number = next(self._numbers)
        answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._answers[number] = answer
        self.say(Operation(number=number, who=who, request=request))
        try:
            async with asyncio.timeout(_ANSWER_WITHIN):
                return await answer
        except TimeoutError:
            raise SilentRunError(
                f"the run has not answered within {_ANSWER_WITHIN:g} s; nobody knows whether it "
                "was done"
            ) from None
        finally:
            self._answers.pop(number, None)

    @contextlib.contextmanager
    def stream(self, every: float) -> Any:
        """A subscription to cycles while the context lasts."""
        subscription = Subscription(every)
        self._subscriptions.add(subscription)
        self._want()
        try:
            yield subscription
        finally:
            self._subscriptions.discard(subscription)
            self._want()

    @property
    def streams(self) -> int:
        """How many stream cycles."""
        return len(self._subscriptions)

    def _want(self) -> None:
        """Ask for as many cycles as the one who wants most; for none where nobody does."""
        every = min((s.every for s in self._subscriptions), default=None)
        if every != self._every:
            self._every = every
            self.say(WantCycles(every=every))
