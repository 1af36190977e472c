"""A serial line on which devices speak by themselves: the last of each message, and silences."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Mapping, Sequence
from functools import partial

from abbe.drivers.bus_lock import BusLock
from abbe.drivers.link import (
    LinkDownError,
    LinkProtocolError,
    LinkStatus,
    LinkTimeoutError,
    Quality,
    Sample,
    TooLateError,
)
from abbe.drivers.quarantine import MemberHealth
from abbe.drivers.reconnect import Reconnector
from abbe.drivers.serial.checksum import shown
from abbe.drivers.serial.commands import send_commands
from abbe.drivers.serial.config import SerialConfig
from abbe.drivers.serial.fields import FieldError
from abbe.drivers.serial.port.lines import Splitter
from abbe.drivers.serial.port.opening import open_port
from abbe.drivers.serial.port.port import Port
from abbe.drivers.serial.port.sending import see_sent
from abbe.drivers.serial.question import SerialMessage, framed

logger = logging.getLogger("abbe.drivers.serial")

_NAN = float("nan")
_LISTEN = 0.01
"""s between two looks at whether something waits to be read: by so much a value may be younger
than it is stated to be."""
_LATE = 0.05
"""s by which a timer may ring late before we count as stalled."""


class StreamingLine:
    """One port and the devices on it, which send without being asked.

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
        self._messages = tuple(SerialMessage(name, config) for name in config.messages)
        self._of = {channel: message for message in self._messages for channel in message.readers}
        self.reconnector = Reconnector(
            label,
            config,
            status,
            self._connect,
            self._disconnect,
            logger,
            lambda: self._health.renew(),
        )
        self._bus_lock = BusLock(self.reconnector, config.max_waiting)
        self._health = MemberHealth(self._messages, config, self.reconnector, logger, "message")
        self._splitter = Splitter(config.terminator.encode("ascii"), config.max_line)
        self._port: Port | None = None
        self._arrived: dict[SerialMessage, float] = {}
        self._opened_at = 0.0
        self._last: dict[str, Sample] = {}
        self._stray = ""
        self._first: asyncio.Future[None] | None = None
        self._watch: asyncio.TimerHandle | None = None
        self._listening: asyncio.TimerHandle | None = None
        self._began = 0.0
        """When the line that is coming cannot have begun before (monotonic, s)."""

    async def close(self) -> None:
        """End everything and free the port."""
        await self.reconnector.close()
        await self._free()

    async def read(self, names: Sequence[str]) -> dict[str, Sample]:
        """The last value of each channel, with the earliest time at which it can have been taken.

        That is before its line began to come: bytes that waited for us are no younger for that.
        """
        if self._port is not None:
            self._port.drain()
        now = time.monotonic()
        if not self.reconnector.up:
            why = str(self.reconnector.down_error())
            return dict.fromkeys(names, Sample(_NAN, now, Quality.UNAVAILABLE, why))
        return {name: self._sample(name, now) for name in names}

    async def write(self, values: Mapping[str, float], until: float) -> None:
        """Send commands; nothing confirms them. Nothing is sent after `until` (monotonic, s).

        Raises
        ------
        LinkError
            When they could not be sent.
        """
        send = partial(self._command, until=until)
        await send_commands(self.reconnector.label, self._config, self._bus_lock, values, send)

    async def _command(self, name: str, text: str, until: float) -> None:
        config = self._config
        if self._port is None:
            raise self.reconnector.down_error().leaving(untouched=(name,))
        data = framed(config, text, config.channels[name].checksum)
        limit = config.timeout + config.character_time * len(data)
        try:
            await see_sent(self._port, data, until, limit, self._lose)
        except TooLateError as error:
            raise error.leaving(untouched=(name,)) from None

    def _sample(self, name: str, now: float) -> Sample:
        message = self._of.get(name)
        if message is None:
            return Sample(_NAN, now, Quality.BAD, f"{name} is only written")
        last = self._last.get(name)
        if last is None or now - last.time > message.within:
            return Sample(_NAN, now, Quality.UNAVAILABLE, self._silence(message, now))
        return last

    def _silence(self, message: SerialMessage, now: float) -> str:
        came = self._arrived.get(message)
        since = "since the port was opened" if came is None else f"for {now - came:.1f} s"
        stray = f"; last came {self._stray}" if self._stray else ""
        return f"{message.name} did not come {since}{stray}"

    def _receive(self, data: bytes) -> None:
        since = time.monotonic() if self._port is None else self._port.since
        began = self._began if self._splitter.held else since
        for line in self._splitter.feed(data):
            if line.strip():
                self._take(line, began - self._config.character_time)
            began = since
        self._began = began

    def _take(self, line: bytes, taken: float) -> None:
        """Keep a line's values; what is no message of ours, or spoilt, is only remembered.

        `taken` is the earliest moment (monotonic, s) at which the device can have taken them.
        """
        error: LinkProtocolError | None = None
        for message in self._messages:
            try:
                found = message.match([line])
            except LinkProtocolError as exc:
                error = exc
                continue
            self._status.requests += 1
            self._stray = ""
            self._arrived[message] = time.monotonic()
            for channel in message.readers:
                try:
                    self._last[channel] = Sample(message.value(channel, found), taken)
                except FieldError as exc:
                    self._last[channel] = Sample(_NAN, taken, Quality.BAD, str(exc))
            if message.failures:
                self._health.answered(message)
            if self._first is not None and not self._first.done():
                self._first.set_result(None)
            return
        self._status.failures += 1
        self._stray = str(error) if len(self._messages) == 1 else shown(line)

    def _listen(self) -> None:
        """See that nothing waits to be read: what comes then is no older."""
        if self._port is not None:
            self._port.drain()
            self._listening = asyncio.get_running_loop().call_later(_LISTEN, self._listen)

    def _look(self, due: float) -> None:
        """Now and then: which messages have not come for too long?"""
        now = time.monotonic()
        if now - due > _LATE:
            self._watch_on()
            return  # it was us who were stalled: what has come is to be taken in first
        silent = [m for m in self._messages if now - self._came(m) > m.within]
        if len(silent) == len(self._messages):
            self.reconnector.lost(self._silence(silent[0], now))
            return
        for message in silent:
            message.why = self._silence(message, now)
            self._health.set_apart(message, message.why)
        self._watch_on()

    def _came(self, message: SerialMessage) -> float:
        """When a message came last (monotonic, s), or since when it could have come."""
        return self._arrived.get(message, self._opened_at)

    def _watch_on(self) -> None:
        pause = min(message.within for message in self._messages) / 4.0
        due = time.monotonic() + pause
        self._watch = asyncio.get_running_loop().call_later(pause, self._look, due)

    async def _connect(self) -> None:
        """Open the port and wait for a first message."""
        config = self._config
        await self._free()
        self._splitter.clear()
        self._arrived.clear()
        self._last.clear()
        self._stray = ""
        self._first = asyncio.get_running_loop().create_future()
        self._port = await open_port(config, self._receive, self._lose)
        self._listen()
        for text in config.on_open:
            self._port.write(framed(config, text, None))
        longest = max(message.within for message in self._messages)
        try:
            await asyncio.wait_for(self._first, longest)
        except TimeoutError:
            stray = f"; last came {self._stray}" if self._stray else ""
            raise LinkTimeoutError(
                f"the port is open, and no message came in {longest:g} s{stray}"
            ) from None
        finally:
            self._first = None
        self._opened_at = time.monotonic()
        self._watch_on()

    def _lose(self, why: str) -> None:
        if self._first is not None and not self._first.done():
            self._first.set_exception(LinkDownError(why))
        self.reconnector.lost(why)

    def _disconnect(self) -> None:
        for timer in (self._watch, self._listening):
            if timer is not None:
                timer.cancel()
        self._watch = self._listening = None
        if self._port is not None:
            self._port.close()

    async def _free(self) -> None:
        self._disconnect()
        port, self._port = self._port, None
        if port is not None:
            await port.closed()
