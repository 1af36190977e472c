"""Asking an I++ DME server in turn: samples, silences, its errors by severity, its sessions."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Sequence

from abbe.drivers.bus_lock import BusLock
from abbe.drivers.ipp.config import IppConfig
from abbe.drivers.ipp.errors import ServerError, Severity, StoppedError
from abbe.drivers.ipp.grammar import Value
from abbe.drivers.ipp.latest import Latest
from abbe.drivers.ipp.question import IppQuestion, positions, questions
from abbe.drivers.ipp.reports import MoveReport
from abbe.drivers.ipp.session import Session
from abbe.drivers.ipp.state import ServerState
from abbe.drivers.link import (
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkStatus,
    LinkTimeoutError,
    Quality,
    Sample,
)
from abbe.drivers.quarantine import MemberHealth
from abbe.drivers.reconnect import Reconnector

logger = logging.getLogger("abbe.drivers.ipp")

_NAN = float("nan")
_MARK_EVERY = 0.1
"""s between two questions of which the answers' places among the reports tell how old those are."""
_OVERTAKES = "E0999"
"""Tag of a command that overtakes the others."""
_SILENCES = 2
"""Commands that one call waits for in vain before it gives up on the rest."""


class Asking:
    """One server, asked in turn over one session.

    Parameters
    ----------
    label
        The link, for people.
    config
        Its section.
    status
        Kept up to date.
    """

    def __init__(self, label: str, config: IppConfig, status: LinkStatus) -> None:
        self._config = config
        self._status = status
        self._regular = questions(config)
        self._of = {name: question for question in self._regular for name in question.fields}
        self._reports: MoveReport | None = None
        self._frame: IppQuestion | None = None
        self._mark = ""
        """What is asked for the place of its answer among the reports."""
        self._probes = list(self._regular)
        self._all = list(self._regular)
        if config.axes and config.move_report is not None:
            get = positions(config, None)
            self._mark = get.command
            self._reports = MoveReport(config.move_report, get)
            self._probes.insert(0, get)
            self._all += [get, self._reports.question]
        if config.axes and config.coordinates != "any":
            self._frame = IppQuestion(
                "GetCoordSystem", (), config.coordinates_every, {}, vital=True
            )
            self._all.append(self._frame)
            self._mark = self._frame.command
        self.reconnector = Reconnector(
            label, config, status, self._connect, self._disconnect, logger,
            lambda: self._health.renew(),
        )  # fmt: skip
        self._bus_lock = BusLock(self.reconnector, config.max_waiting)
        self._health = MemberHealth(self._all, config, self.reconnector, logger, "command")
        self._state = ServerState(label, config, status, self._health)
        self._session: Session | None = None
        self._closing = False
        self._latest = Latest()

    async def close(self) -> None:
        """End the session where there is one, the connection, and the background task."""
        self._closing = True
        session = self._session
        if session is not None and self.reconnector.up:
            if self._reports is not None and self._reports.ordered:
                with contextlib.suppress(LinkError):
                    await session.ask(f"StopDaemon({self._reports.tag})")
            with contextlib.suppress(LinkError):
                await session.ask("EndSession()")
            await session.end()
        await self.reconnector.close()

    async def read(self, names: Sequence[str]) -> dict[str, Sample]:
        """As `abbe.drivers.link.Link.read`."""
        try:
            async with self._bus_lock:
                await self._ask_due(names)
                now = time.monotonic()
                return {name: self._sample(name, now) for name in names}
        except LinkError as error:
            lost = Sample(_NAN, time.monotonic(), Quality.UNAVAILABLE, str(error))
            return dict.fromkeys(names, lost)

    async def command(self, text: str, within: float) -> tuple[Value, ...]:
        """Have a command carried out that no channel asks for; its data.

        Raises
        ------
        StoppedError
            When it failed with an error that stops the server.
        LinkError
            When it was not completed in `within` s, and when the connection is lost.
        """
        async with self._bus_lock:
            session = self._session
            if session is None:
                raise LinkDownError("the connection is closed")
            self._status.requests += 1
            try:
                reply = await session.ask(text, within=within)
            except StoppedError as error:
                self._status.failures += 1
                self._state.halt(error.error)
                raise
            except LinkDownError as error:
                self._status.failures += 1
                if not self._closing:
                    self.reconnector.lost(str(error))
                raise
            self._state.resume()
            return reply.data

    async def overtake(self, text: str) -> None:
        """Have an event command carried out beside whatever the server is at: ``AbortE()``.

        Raises
        ------
        LinkError
            When it was not.
        """
        session = self._session
        if session is None or not self.reconnector.up:
            raise LinkDownError("the connection is closed")
        await session.ask(text, _OVERTAKES)

    def command_of(self, name: str) -> str:
        """The command by which a channel is had."""
        if self._reports is not None and self._config.channels[name].axis is not None:
            return self._reports.question.command
        return self._of[name].command

    def _sample(self, name: str, now: float) -> Sample:
        state, frame = self._state, self._frame
        is_axis = self._config.channels[name].axis is not None
        reports = self._reports if is_axis else None
        question = self._of[name] if reports is None else reports.question
        unknown = frame.refused if is_axis and frame is not None else ""
        wrong = question.refused or unknown or state.stopped
        if is_axis:
            wrong = wrong or state.misplaced or state.lost_frame(now)
        if wrong:
            return Sample(_NAN, now, Quality.BAD, wrong)
        if reports is not None:
            return reports.sample(name, now)
        return self._latest.sample(question, name, now)

    def _due(self, names: Sequence[str], now: float) -> list[IppQuestion]:
        """What to ask: the coordinate system, positions, the rest; last, what is in trouble."""
        due: dict[IppQuestion, None] = {}
        frame, reports, channels = self._frame, self._reports, self._config.channels
        axes = any(channels[name].axis is not None for name in names)
        if axes and frame is not None and self._state.frame_is_due(now):
            due[frame] = None
        if reports is not None and not reports.ordered:
            due[reports.question] = None
        for name in names:
            question = self._of.get(name)
            if question is not None and self._latest.is_due(question, name, now):
                due[question] = None
        return sorted((q for q in due if q.may_be_asked(now)), key=lambda q: q.failures)

    async def _ask_due(self, names: Sequence[str]) -> None:
        now = time.monotonic()
        due = self._due(names, now)
        if self._state.stopped:
            if not self._state.try_again(now):
                return
            due = due or [probe for probe in self._probes if probe.may_be_asked(now)][:1]
            await self._clear()
        else:
            await self._look_for_reports(now)
            if self._reports is not None and self._session is not None:
                self._session.mark(self._mark, _MARK_EVERY)
        silences = 0
        for question in due:
            if not self.reconnector.up:
                break
            if question.failures and (why := question.refusal(time.monotonic())):
                self._latest.mark(question, Quality.UNAVAILABLE, why)
                continue
            if silences and (question.failures or silences >= _SILENCES):
                why = question.why or "not asked: the server keeps the others waiting"
                self._latest.mark(question, Quality.UNAVAILABLE, why)
                continue
            try:
                await self._exchange(question)
            except StoppedError:
                # whatever else were sent now would be refused
                break
            except LinkProtocolError as error:
                self._latest.mark(question, Quality.BAD, str(error))
            except LinkTimeoutError as error:
                silences += 1
                self._latest.mark(question, Quality.UNAVAILABLE, str(error))
            except LinkDownError:
                break
        if not self.reconnector.up:
            raise self.reconnector.down_error()

    async def _look_for_reports(self, now: float) -> None:
        if self._reports is not None and self._reports.silence(now):
            # a report may wait in the socket, when it was this process that was held up
            await asyncio.sleep(0.01)
            if why := self._reports.silence(now):
                self.reconnector.lost(why)

    async def _exchange(self, question: IppQuestion) -> None:
        """Ask once, and keep what comes."""
        status, session, reports = self._status, self._session, self._reports
        if session is None:
            raise LinkDownError("the connection is closed")
        ordering = reports if reports is not None and question is reports.question else None
        status.requests += 1
        question.asked = True
        try:
            reply = await session.ask(question.command, ordering.tag if ordering else None)
        except LinkTimeoutError as error:
            status.failures += 1
            self._health.unanswered(question, str(error))
            raise
        except StoppedError as error:
            status.failures += 1
            self._answered(question)
            self._state.halt(error.error, question)
            raise
        except LinkProtocolError:
            status.failures += 1
            self._answered(question)
            raise
        except LinkError as error:
            status.failures += 1
            if not self._closing:
                self.reconnector.lost(str(error))
            raise LinkDownError(str(error)) from error
        status.round_trip = session.round_trip
        self._answered(question)
        self._state.accepted(question)
        self._state.resume()
        for warning in reply.warnings:
            self._state.warn(warning)
        if ordering is not None:
            ordering.order_taken()
        elif question is self._frame:
            self._state.look_at_frame(reply.data, reply.asked_at)
        else:
            self._latest.keep(question, reply)

    def _answered(self, question: IppQuestion) -> None:
        self._health.silent_in_a_row = 0
        if question.failures:
            self._health.answered(question)

    def _on_error(self, error: ServerError) -> None:
        """An error that belongs to no command: the server's own, or one of a late answer."""
        if error.severity is Severity.FATAL:
            self._lose(str(error))
        elif error.stops:
            self._state.halt(error)
        else:
            self._state.warn(error)

    def _on_event(self, tag: str, text: str) -> None:
        reports, session = self._reports, self._session
        if reports is None or session is None or tag != reports.tag:
            return
        self._status.requests += 1
        if not reports.take(text, session.since):
            self._status.failures += 1

    async def _clear(self) -> None:
        """Clear the server's errors, where the user wants that."""
        if self._config.clear_errors and self._session is not None:
            with contextlib.suppress(LinkError):
                await self._session.ask("ClearAllErrors()")

    async def _connect(self) -> None:
        """Connect, start a session, get a first answer: a port that is taken in is not up."""
        config, self._closing = self._config, False
        async with self._bus_lock.lock:
            self._disconnect()
            self._latest.clear()
            self._state.renew(self._all)
            if self._reports is not None:
                self._reports.renew()
            session = self._session = Session(
                config.timeout, self._on_event, self._on_error, self._lose
            )
            await session.open(config.host, config.port)
            try:
                await session.ask("StartSession()")
            except StoppedError:
                if not config.clear_errors:
                    raise
                await self._clear()
                await session.ask("StartSession()")
            await self._first_answer()

    async def _first_answer(self) -> None:
        reports = self._reports
        question = self._regular[0] if reports is None else reports.question
        try:
            await self._exchange(question)
        except LinkProtocolError:
            # it answers; what it says is the samples' business
            return
        if reports is not None and reports.first is not None:
            try:
                async with asyncio.timeout(reports.wait_limit):
                    await asyncio.shield(reports.first)
            except TimeoutError:
                raise LinkTimeoutError(
                    f"{question.command} was accepted, and no report came in "
                    f"{reports.wait_limit:g} s"
                ) from None

    def _lose(self, why: str) -> None:
        if self._reports is not None:
            self._reports.give_up(why)
        if self.reconnector.up:
            self.reconnector.lost(why)
        elif self._session is not None:
            self._session.abandon()

    def _disconnect(self) -> None:
        if self._session is not None:
            self._session.abandon()
