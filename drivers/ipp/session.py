"""One connection to an I++ DME server: commands out with tags, answers matched to them by tag.

An answer that comes late has the tag of a command that nobody waits for any more, and is dropped;
it cannot pass for another's. Tags are counted up, and one that is still owed an answer is left out
when they begin again.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from abbe.drivers.ipp.errors import ServerError, Severity, StoppedError, server_error
from abbe.drivers.ipp.grammar import Value, parse
from abbe.drivers.ipp.wire import Cutter, ResponseKind, ResponseLine
from abbe.drivers.link import LinkDownError, LinkProtocolError, LinkTimeoutError

LAST_TAG = 99_999
CONNECT_TIMEOUT = 3.0
"""Least time in s for a TCP connection; nobody waits for it but the first `open`."""
_MOST_OWED = 1000
_MOST_UNSENT = 1 << 16
"""Bytes that may wait to be sent."""


@dataclass(slots=True)
class _Transaction:
    answer: asyncio.Future[None]
    began: float
    taken: bool = False
    data: list[str] = field(default_factory=list)
    warnings: list[ServerError] = field(default_factory=list)
    error: ServerError | None = None


@dataclass(frozen=True, slots=True)
class CommandReply:
    """The reply to one command.

    Attributes
    ----------
    data
        All values of all its lines of data.
    asked_at
        Monotonic time in s at which the command left.
    warnings
        Errors of severity 0 and 1 that came with them.
    """

    data: tuple[Value, ...]
    asked_at: float
    warnings: tuple[ServerError, ...] = ()


class Session(asyncio.Protocol):
    """One TCP connection to an I++ DME server.

    Parameters
    ----------
    timeout
        s for a command to be completed.
    on_event
        Called with tag and text of data that comes with an event's tag.
    on_error
        Called with an error that belongs to no command that is waited for.
    on_lost
        Called once, with the reason, when the connection is lost; not when `abandon` ends it.

    Attributes
    ----------
    round_trip
        s from the last command to its completion.
    late
        Answers that came after their command was given up.
    since
        Monotonic time in s before which the server did not send what is being taken in: when the
        last command left whose answer stands before it in the stream.
    """

    def __init__(
        self,
        timeout: float,
        on_event: Callable[[str, str], None],
        on_error: Callable[[ServerError], None],
        on_lost: Callable[[str], None],
    ) -> None:
        self._timeout = timeout
        self._on_event = on_event
        self._on_error = on_error
        self._on_lost = on_lost
        self._cutter = Cutter()
        self._transport: asyncio.Transport | None = None
        self._waiting: dict[str, _Transaction] = {}
        self._owed: dict[str, float] = {}
        """Tag → when the command left of which answers may still come."""
        self._number = 0
        self._closed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._abandoned = False
        self.round_trip = float("nan")
        self.late = 0
        self.since = -math.inf
        self._marks: dict[str, float] = {}
        """Tag → when it left, of the last command that nobody waits for."""
        self._marked_at = -math.inf

    async def open(self, host: str, port: int) -> None:
        """Connect.

        Raises
        ------
        LinkDownError
            When there is no connection in time; says why.
        """
        limit = max(self._timeout, CONNECT_TIMEOUT)
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(limit):
                await loop.create_connection(lambda: self, host, port)
        except TimeoutError:
            raise LinkDownError(f"no connection in {limit:g} s") from None
        except OSError as error:
            raise LinkDownError(f"no connection: {error.strerror or error}") from error

    async def ask(
        self, command: str, event: str | None = None, *, within: float | None = None
    ) -> CommandReply:
        """Send a command and wait until it is completed.

        Parameters
        ----------
        command
            Without tag: ``Get(X(), Y())``.
        event
            Tag to send it with, whose data then goes to `on_event`; default the next number.
        within
            s for it to be completed, where that is another time than the session's.

        Raises
        ------
        LinkTimeoutError
            When it is not completed in time.
        StoppedError
            When it failed with an error of severity 2 or 3.
        LinkProtocolError
            When the data is not understood.
        LinkDownError
            When the connection is lost, or the error is fatal.
        """
        transport = self._transport
        if transport is None or transport.is_closing():
            raise LinkDownError("the connection is closed")
        if transport.get_write_buffer_size() > _MOST_UNSENT:
            raise LinkDownError("the server takes nothing any more")
        tag = self._next_tag() if event is None else event
        loop = asyncio.get_running_loop()
        began = time.monotonic()
        transaction = self._waiting[tag] = _Transaction(loop.create_future(), began)
        limit = self._timeout if within is None else within
        give_up = loop.call_later(limit, _expire, transaction.answer)
        completed = False
        try:
            transport.write(f"{tag} {command}\r\n".encode("ascii"))
            await transaction.answer
            completed = True
        except TimeoutError:
            if transaction.error is None:
                what = "taken and not completed" if transaction.taken else "no answer"
                stray = f"; last came {self._cutter.last_stray}" if self._cutter.last_stray else ""
                raise LinkTimeoutError(f"{command}: {what} in {limit:g} s{stray}") from None
        finally:
            give_up.cancel()
            del self._waiting[tag]
            if not completed:
                self._owe(tag, began)
        self.round_trip = time.monotonic() - began
        return self._reply(command, transaction)

    def mark(self, command: str, every: float) -> None:
        """Send a command only for the place of its answer in the stream; nothing waits for it.

        Not more than one at a time, and not when `since` is less than `every` s ago.
        """
        now, transport = time.monotonic(), self._transport
        if transport is None or transport.is_closing() or now - self.since < every:
            return
        if now - self._marked_at < (self._timeout if self.since < self._marked_at else every):
            return
        self._marked_at = now
        tag = self._next_tag()
        self._marks = {tag: now}
        transport.write(f"{tag} {command}\r\n".encode("ascii"))

    def abandon(self) -> None:
        """Give the connection up at once; safe to call twice."""
        self._abandoned = True
        if self._transport is not None:
            self._transport.abort()
        self._fail("the connection was given up")

    async def end(self) -> None:
        """Close the connection, and wait (bounded) until it is."""
        self._abandoned = True
        if self._transport is not None:
            self._transport.close()
            await asyncio.wait([self._closed], timeout=self._timeout)
        self.abandon()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """As `asyncio.Protocol`."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101
        self._transport = transport
        if self._abandoned:
            transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """As `asyncio.Protocol`."""
        if not self._closed.done():
            self._closed.set_result(None)
        why = "the server closed the connection"
        if exc is not None:
            why = f"the connection was lost: {getattr(exc, 'strerror', None) or exc}"
        self._fail(why)
        if not self._abandoned:
            self._abandoned = True
            self._on_lost(why)

    def data_received(self, data: bytes) -> None:
        """As `asyncio.Protocol`."""
        for message in self._cutter.feed(data):
            if self._abandoned:
                return
            self._take(message)

    @property
    def strays(self) -> int:
        """Lines that were no responses."""
        return self._cutter.strays

    def _take(self, message: ResponseLine) -> None:
        tag, kind, text = message
        transaction = self._waiting.get(tag)
        if not tag.startswith("E"):
            # numbers are used once; an event's tag says nothing of when it was asked for
            known = self._owed | self._marks
            asked_at = known.get(tag, -math.inf) if transaction is None else transaction.began
            self.since = max(self.since, asked_at)
        if kind is ResponseKind.DATA and tag.startswith("E"):
            # what an event reports may come before its command is completed
            self._on_event(tag, text)
        elif transaction is None or transaction.answer.done():
            self._unexpected(message)
        elif kind is ResponseKind.TAKEN:
            transaction.taken = True
        elif kind is ResponseKind.DATA:
            transaction.data.append(text)
        elif kind is ResponseKind.DONE:
            transaction.answer.set_result(None)
        else:
            error = server_error(text)
            if not error.stops:
                transaction.warnings.append(error)
                return
            transaction.error = error
            if error.severity is Severity.FATAL:
                transaction.answer.set_result(None)

    def _unexpected(self, message: ResponseLine) -> None:
        if message.kind is ResponseKind.ERROR:
            self._on_error(server_error(message.text))
        if message.tag in self._owed:
            self.late += 1
            if message.kind is ResponseKind.DONE:
                del self._owed[message.tag]

    def _reply(self, command: str, transaction: _Transaction) -> CommandReply:
        error = transaction.error
        if error is not None:
            said = f"{command}: {error}"
            if error.severity is Severity.FATAL:
                raise LinkDownError(said)
            raise StoppedError(said, error)
        try:
            data = tuple(value for line in transaction.data for value in parse(line))
        except LinkProtocolError as problem:
            raise LinkProtocolError(f"{command}: {problem}") from None
        return CommandReply(data, transaction.began, tuple(transaction.warnings))

    def _next_tag(self) -> str:
        while True:
            self._number = self._number % LAST_TAG + 1
            tag = f"{self._number:05d}"
            if tag not in self._waiting and tag not in self._owed:
                return tag

    def _owe(self, tag: str, asked_at: float) -> None:
        self._owed[tag] = asked_at
        if len(self._owed) > _MOST_OWED:
            del self._owed[next(iter(self._owed))]

    def _fail(self, why: str) -> None:
        for transaction in self._waiting.values():
            if not transaction.answer.done():
                with contextlib.suppress(asyncio.InvalidStateError):
                    transaction.answer.set_exception(LinkDownError(why))


def _expire(answer: asyncio.Future[None]) -> None:
    if not answer.done():
        answer.set_exception(TimeoutError())
