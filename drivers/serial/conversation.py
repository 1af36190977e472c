"""Question and answer on an open port, one at a time; nothing late passes for an answer.

An ASCII answer does not say which query it answers. After a query that went unanswered (or whose
caller was cancelled) its answer may still come, and would pass for the next one's: a position of
long ago without an error. So a line that comes while one is *pending* and fits it is taken for it
and dropped; and what the pending one could be confused with is not asked before its answer has
come or can come no more.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Collection, Sequence

from abbe.compcore.units import in_digits
from abbe.drivers.link import LinkDownError, LinkProtocolError, LinkTimeoutError, TooLateError
from abbe.drivers.reply_wait import ReplyWait
from abbe.drivers.serial.checksum import shown
from abbe.drivers.serial.config import LineConfig
from abbe.drivers.serial.patterns import Match
from abbe.drivers.serial.port.lines import Splitter
from abbe.drivers.serial.port.opening import open_port
from abbe.drivers.serial.port.port import Port
from abbe.drivers.serial.port.sending import see_sent, withdrawn
from abbe.drivers.serial.question import DeviceRefusedError, SerialQuestion

_ECHOED = "it begins with what was asked: is that an echo (local_echo = true)?"


class LateAnswerError(LinkTimeoutError):
    """Nothing was asked: the answer to an earlier query may still come and pass for this one's."""


class Conversation:
    """One serial line on which we ask and the devices answer.

    Parameters
    ----------
    config
        The link's section.
    questions
        Everything that is ever asked.
    on_lost
        Called with the reason when the port is lost; not when `close` closes it.

    Attributes
    ----------
    round_trip
        s from sending the last query to its answer.
    asked_at
        Monotonic time in s at which the last query left.
    answered_at
        Monotonic time in s of its answer, or of giving up.
    """

    def __init__(
        self,
        config: LineConfig,
        questions: Collection[SerialQuestion],
        on_lost: Callable[[str], None],
    ) -> None:
        self._config = config
        self._pause = config.pause
        self._character_time = config.character_time
        self._questions = tuple(questions)
        self._on_lost = on_lost
        self._port: Port | None = None
        self._splitter = Splitter(config.terminator.encode("ascii"), config.max_line)
        self._current: SerialQuestion | None = None
        self._answer: ReplyWait[Match] = ReplyWait(self._wait)
        self._lines: list[bytes] = []
        self._unfit: LinkProtocolError | None = None
        self._came = b""
        self._echo: bytes | None = None
        self.round_trip = float("nan")
        self.asked_at = self.answered_at = 0.0

    async def open(self) -> None:
        """Open the port; an old one is closed first.

        Raises
        ------
        LinkDownError
            With the reason.
        """
        await self.close()
        self._splitter.clear()
        self._port = await open_port(self._config, self._receive, self._lose)

    def abandon(self) -> None:
        """Close the port without waiting for it; a query in flight fails at once."""
        if self._port is not None:
            self._port.close()
        self._fail("the port was closed")

    async def close(self) -> None:
        """Close the port and wait (bounded) until it can be opened again."""
        self.abandon()
        port, self._port = self._port, None
        if port is not None:
            await port.closed()

    def _pending(self) -> Sequence[SerialQuestion]:
        """Questions to which an answer may still come late."""
        for question in self._questions:
            if question.asked_at is not None:
                return [question for question in self._questions if question.asked_at is not None]
        return ()

    def _refuse(self, question: SerialQuestion, pending: Sequence[SerialQuestion]) -> None:
        """Refuse to ask now because of an answer that may still come."""
        now = time.monotonic()
        for other in pending:
            if other.asked_at is None:
                continue
            wait = other.asked_at + self._config.late_reply_max - now
            if wait <= 0:
                other.asked_at = None
            elif question.confusable(other):
                raise LateAnswerError(
                    f"{other.name} may still be answered late; asked again in {wait:.1f} s"
                )

    def tell(self, data: bytes) -> None:
        """Send something that is not answered.

        Raises
        ------
        LinkDownError, LinkError
            As `abbe.drivers.serial.port.port.Port.write`.
        """
        self._open_port().write(data)

    async def say(self, data: bytes, until: float) -> None:
        """Send something that is not answered, and see it leave; only one caller at a time.

        Parameters
        ----------
        data
            Complete.
        until
            Monotonic time in s after which it is not sent.

        Raises
        ------
        TooLateError
            When it is later; nothing was sent.
        LinkDownError
            When the device does not let it out in time, or the port is lost.
        """
        await see_sent(self._open_port(), data, until, self._limit(len(data)), self._lose)

    async def ask(self, question: SerialQuestion, data: bytes, until: float = math.inf) -> Match:
        """Send a query and wait for its answer; only one caller at a time.

        What comes and does not fit (noise, our own echo) is passed over; when nothing better comes
        in time, it was the answer, spoilt.

        Parameters
        ----------
        question
            What is asked.
        data
            The query, complete.
        until
            Monotonic time in s after which it is not sent.

        Raises
        ------
        TooLateError
            When it is later; nothing was sent.
        LateAnswerError
            When an answer that is late could be taken for this one's; nothing was sent.
        LinkTimeoutError
            When no (whole) answer came in time.
        LinkProtocolError
            When what came in time does not fit, or the device says that it cannot.
        LinkDownError
            When the port is lost, or does not let the query out.
        """
        config = self._config
        port = self._open_port()
        if pending := self._pending():
            self._refuse(question, pending)
        if self._pause:
            wait = self.answered_at + self._pause - time.monotonic()
            if wait > 0:
                await asyncio.sleep(wait)
        if not port.drain():
            raise LinkProtocolError("the device sends without end, asked or not")
        if not pending or not self._pending():
            self._splitter.clear()
        limit = self._limit(len(data) + question.lines * config.max_line)
        self._current, self._lines, self._unfit = question, [], None
        self._echo = data if config.local_echo else None
        answer = self._answer
        began = self.asked_at = time.monotonic()
        if began > until:
            raise TooLateError(f"{question.name}: too old before it could be sent, so not sent")
        answer.begin()
        try:
            port.write(data)
            found = await answer.get(limit)
        except TimeoutError:
            if self._unfit is not None:
                if self._heard_itself(data):
                    raise LinkProtocolError(f"{self._unfit}; {_ECHOED}") from None
                raise self._unfit from None
            question.asked_at = began
            if port.unsent:
                raise withdrawn(port, self._lose) from None
            raise LinkTimeoutError(self._silence(question, limit)) from None
        except asyncio.CancelledError:
            question.asked_at = began
            raise
        finally:
            answer.end()
            self._current = self._echo = None
            self.answered_at = time.monotonic()
        self.round_trip = self.answered_at - began
        return found

    def _heard_itself(self, data: bytes) -> bool:
        """Whether what came begins with what was asked, and nobody has said that it would."""
        return not self._config.local_echo and self._came.startswith(data.rstrip(b"\r\n") or b"\n")

    def _limit(self, characters: int) -> float:
        """Time in s for so many characters there and back."""
        return self._config.timeout + self._character_time * characters

    def _silence(self, question: SerialQuestion, limit: float) -> str:
        got = b" ".join([*self._lines, self._splitter.held])
        more = f" ({shown(got)} came, and no end)" if got else ""
        return f"{question.name}: no answer in {in_digits(limit)} s{more}"

    def _open_port(self) -> Port:
        if self._port is None:
            raise LinkDownError("the port is closed")
        return self._port

    def _wait(self, seconds: float) -> bool:
        return self._port is not None and self._port.wait(seconds)

    def _receive(self, data: bytes) -> None:
        if self._echo is not None:
            # Our own query comes first, byte by byte the same.
            known = min(len(self._echo), len(data))
            if data[:known] == self._echo[:known]:
                data, self._echo = data[known:], self._echo[known:]
            if not self._echo:
                self._echo = None
        for line in self._splitter.feed(data):
            if line.strip():
                self._take(line)

    def _take(self, line: bytes) -> None:
        for late in self._pending():
            if late.fits(line):
                late.asked_at = None
                return
        question, answer = self._current, self._answer
        if question is None or not answer.waiting:
            return
        self._lines.append(line)
        if len(self._lines) < question.lines:
            return
        try:
            answer.give(question.match(self._lines))
        except DeviceRefusedError as error:
            answer.fail(error)
        except LinkProtocolError as error:
            self._unfit, self._came = error, self._lines[0]
            del self._lines[0]

    def _lose(self, why: str) -> None:
        self._fail(why)
        self._on_lost(why)

    def _fail(self, why: str) -> None:
        self._answer.fail(LinkDownError(why))
