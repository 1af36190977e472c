"""A serial line whose devices answer queries: samples, commands, and which of them are silent."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Mapping, Sequence
from functools import partial

from abbe.drivers.bus_lock import BusLock
from abbe.drivers.link import (
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkStatus,
    LinkTimeoutError,
    Quality,
    Sample,
    TooLateError,
)
from abbe.drivers.quarantine import MemberHealth
from abbe.drivers.reconnect import Reconnector
from abbe.drivers.serial.commands import send_commands
from abbe.drivers.serial.config import SerialConfig
from abbe.drivers.serial.conversation import Conversation, LateAnswerError
from abbe.drivers.serial.fields import FieldError
from abbe.drivers.serial.patterns import Match
from abbe.drivers.serial.question import DeviceRefusedError, SerialMessage, SerialQuestion, framed

logger = logging.getLogger("abbe.drivers.serial")

_NAN = float("nan")
_SILENCES = 2
"""Messages that one call waits for in vain before it gives up on the rest."""


class AskedLine:
    """One port and the devices on it, which speak when spoken to.

    Parameters
    ----------
    label
        The link, for people.
    config
        Its section.
    status
        Kept up to date.
    """

    def __init__(self, label: str, config: SerialConfig, status: LinkStatus) -> None:
        self._config = config
        self._status = status
        self._messages = {name: SerialMessage(name, config) for name in config.messages}
        self._of = {
            channel: message for message in self._messages.values() for channel in message.readers
        }
        self._commands = {
            name: SerialQuestion(
                f"command {name}", part.acknowledge or "", 1, part.checksum, part.refused
            )
            for name, part in config.channels.items()
            if part.writable
        }
        questions: tuple[SerialQuestion, ...] = (*self._messages.values(), *self._commands.values())
        self.reconnector = Reconnector(
            label,
            config,
            status,
            self._connect,
            lambda: self._talk.abandon(),
            logger,
            lambda: self._health.renew(),
        )
        self._bus_lock = BusLock(self.reconnector, config.max_waiting)
        self._talk = Conversation(config, questions, self.reconnector.lost)
        self._health = MemberHealth(questions, config, self.reconnector, logger, "query")
        self._epoch = 0
        self._last: dict[str, Sample] = {}
        self._always: dict[tuple[str, ...], Sequence[SerialMessage]] = {}

    async def close(self) -> None:
        """End everything and free the port."""
        await self.reconnector.close()
        await self._talk.close()

    async def read(self, names: Sequence[str]) -> dict[str, Sample]:
        """As `abbe.drivers.link.Link.read`."""
        try:
            async with self._bus_lock:
                if self.reconnector.epoch != self._epoch:
                    self._epoch = self.reconnector.epoch
                    self._last.clear()
                wanted = tuple(names)
                await self._ask_all(self._always.get(wanted) or self._due(wanted))
                last = self._last
                return {name: last[name] for name in names}
        except LinkError as error:
            lost = Sample(_NAN, time.monotonic(), Quality.UNAVAILABLE, str(error))
            return dict.fromkeys(names, lost)

    async def write(self, values: Mapping[str, float], until: float) -> None:
        """Send commands in the order in which they are named; each waits for its answer.

        Nothing is sent after `until` (monotonic, s).

        Raises
        ------
        LinkError
            When a value was not taken; says which, and which were before.
        """
        send = partial(self._command, until=until)
        await send_commands(self.reconnector.label, self._config, self._bus_lock, values, send)

    async def _command(self, name: str, text: str, until: float) -> None:
        section, question = self._config.channels[name], self._commands[name]
        data = framed(self._config, text, section.checksum)
        try:
            if section.acknowledge is None:
                await self._talk.say(data, until)
                return
            if why := question.refusal(time.monotonic()):
                raise LateAnswerError(why)
            await self._exchange(question, data, until)
        except (LateAnswerError, TooLateError, DeviceRefusedError) as error:
            raise error.leaving(untouched=(name,)) from None

    def _due(self, names: tuple[str, ...]) -> Sequence[SerialMessage]:
        """Messages to ask for, those in trouble last; kept where it is the same one each time."""
        now = time.monotonic()
        messages: dict[SerialMessage, None] = {}
        for name in names:
            message = self._of.get(name)
            if message is None:
                self._last[name] = Sample(_NAN, now, Quality.BAD, f"{name} is only written")
            elif message not in messages and self._is_due(message, name, now):
                messages[message] = None
        if len(messages) > 1 and any(message.failures for message in messages):
            return sorted(messages, key=lambda message: message.failures)
        due = tuple(messages)
        if len(due) == 1 and not due[0].pace.every and all(name in self._of for name in names):
            self._always[names] = due
        return due

    def _is_due(self, message: SerialMessage, name: str, now: float) -> bool:
        last = self._last.get(name)
        return (
            last is None
            or message.failures > 0
            or last.quality is Quality.UNAVAILABLE
            or message.pace.is_due(now)
        )

    async def _ask_all(self, messages: Sequence[SerialMessage]) -> None:
        silences = 0
        for message in messages:
            if message.failures and (why := message.refusal(time.monotonic())):
                self._mark(message, Quality.UNAVAILABLE, why)
                continue
            if silences and (message.failures or silences >= _SILENCES):
                why = message.why or "not asked: other devices kept the line waiting"
                self._mark(message, Quality.UNAVAILABLE, why)
                continue
            try:
                self._keep(message, await self._exchange(message, message.query))
            except LinkProtocolError as error:
                self._mark(message, Quality.BAD, str(error))
            except LinkTimeoutError as error:
                silences += 1
                self._mark(message, Quality.UNAVAILABLE, str(error))
            except LinkDownError:
                break
        if not self.reconnector.up:
            raise self.reconnector.down_error()

    async def _exchange(
        self, question: SerialQuestion, data: bytes, until: float = math.inf
    ) -> Match:
        status, talk = self._status, self._talk
        status.requests += 1
        question.asked = True
        try:
            found = await talk.ask(question, data, until)
        except (LateAnswerError, TooLateError):
            raise
        except LinkProtocolError:
            status.failures += 1
            self._health.answered(question)
            raise
        except LinkTimeoutError as error:
            status.failures += 1
            self._health.unanswered(question, str(error))
            raise
        except LinkError as error:
            status.failures += 1
            self.reconnector.lost(str(error))
            raise LinkDownError(str(error)) from error
        status.round_trip = talk.round_trip
        self._health.silent_in_a_row = 0
        if question.failures:
            self._health.answered(question)
        return found

    def _keep(self, message: SerialMessage, found: Match) -> None:
        at, last, good = self._talk.asked_at, self._last, True
        for channel, text, reader in message.texts(found):
            try:
                last[channel] = Sample(reader(text), at)
            except FieldError as error:
                last[channel] = Sample(_NAN, at, Quality.BAD, f"{channel}: {error}")
                good = False
        message.pace.asked(at, good=good)

    def _mark(self, message: SerialMessage, quality: Quality, why: str) -> None:
        now = time.monotonic()
        message.pace.asked(now, good=False)
        self._last |= dict.fromkeys(message.readers, Sample(_NAN, now, quality, why))

    async def _connect(self) -> None:
        """Open the port and get a first answer: an open port with nobody behind it is not up."""
        config, talk = self._config, self._talk
        async with self._bus_lock.lock:
            await talk.open()
            for text in config.on_open:
                talk.tell(framed(config, text, None))
            if config.on_open:
                await asyncio.sleep(config.timeout)
            await self._first_answer()

    async def _first_answer(self) -> None:
        error: LinkError | None = None
        for message in sorted(self._messages.values(), key=lambda m: m.failures):
            try:
                await self._exchange(message, message.query)
            except LinkTimeoutError as exc:
                error = exc
            except LinkProtocolError:
                return
            else:
                return
        if error is not None:
            raise LinkTimeoutError(f"the port is open, and no query is answered: {error}")
