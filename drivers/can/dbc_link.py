"""A CAN link by DBC file: the last value of each signal that is on the bus, frames sent."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from drivers.can.bus import CanBus
from drivers.can.dbc_config import DbcConfig, RequestConfig
from drivers.can.dbc_file import load, signal_of
from drivers.can.error_frames import BusErrors
from drivers.can.heard import Heard
from drivers.can.sending import Sending
from drivers.link import (
    ChannelInfo,
    Link,
    LinkConfig,
    LinkConfigError,
    LinkDownError,
    LinkError,
    LinkTimeoutError,
    Quality,
    Sample,
)
from drivers.quarantine import Roster
from drivers.reconnect import Keeper
from drivers.turns import Turns

if TYPE_CHECKING:
    import can

logger = logging.getLogger("abbe.drivers.can")

_NAN = float("nan")
_LOOK = 0.05
"""s between two looks at what has not come."""


class DbcLink(Link):
    """One CAN interface and the signals on its bus.

    Parameters
    ----------
    name
        The link's name in the configuration.
    config
        Its section.

    Raises
    ------
    LinkConfigError
        When the DBC file cannot be read, or lacks a message or signal.
    """

    Config: ClassVar[type[LinkConfig]] = DbcConfig

    def __init__(self, name: str, config: DbcConfig) -> None:
        super().__init__(name, config)
        self._config = config
        self._messages = load(config)
        self._heard = {
            message_name: heard
            for message_name, message in self._messages.items()
            if (heard := Heard(message, config)).channels
        }
        self._by_id = {
            (heard.message.frame_id, heard.message.is_extended_frame): heard
            for heard in self._heard.values()
        }
        self._of = {channel: heard for heard in self._heard.values() for channel in heard.channels}
        self._sending = Sending(name, config, self._messages)
        self._keeper = Keeper(
            f"link {name} ({config.where})",
            config,
            self.status,
            self._connect,
            self._disconnect,
            logger,
            self._up,
        )
        self._bus = CanBus(config, self._take, self._keeper.lost)
        self._roster = Roster(self._heard.values(), config, self._keeper, logger, "message")
        self._errors = BusErrors(self._keeper.lost, self._show)
        self._turns = Turns(self._keeper, config.max_waiting)
        self._awaited: set[Heard] = set()
        self._answered: asyncio.Future[None] | None = None
        self._watch: asyncio.TimerHandle | None = None
        self._up_at = 0.0

    @property
    def channels(self) -> Mapping[str, str]:
        """Channel name → message and signal, and what becomes of it, for people."""
        return {name: self._describe(name) for name in self._config.channels}

    def info(self, channel: str) -> ChannelInfo:
        """Unit (the DBC file's by default), whether it is written, time between requests."""
        section = self._config.channels[channel]
        signal = signal_of(self._messages[section.message], channel, section)
        unit = section.unit if section.unit is not None else (signal.unit or "")
        heard = self._of.get(channel)
        every = heard.every if heard is not None and heard.request is not None else 0.0
        return ChannelInfo(unit, section.writable, every)

    async def open(self) -> None:
        """Open the interface and wait for a first frame, or begin to retry.

        Raises
        ------
        LinkConfigError
            When there is no such interface.
        """
        await self._keeper.open()

    async def close(self) -> None:
        """Close the interface."""
        await self._keeper.close()
        await self._bus.close()

    async def read(self, channels: Sequence[str]) -> dict[str, Sample]:
        """The last value of each signal, with the time at which it came; asks for those that
        have a request.

        Raises
        ------
        LinkConfigError
            When a name is not in the configuration.
        """
        self._check_known(channels)
        try:
            asked = self._to_ask(channels)
            if asked:
                async with self._turns:
                    await self._ask(asked)
            if not self._keeper.up:
                raise self._keeper.down_error()
        except LinkError as error:
            lost = Sample(_NAN, time.monotonic(), Quality.UNAVAILABLE, str(error))
            return dict.fromkeys(channels, lost)
        now = time.monotonic()
        return {name: self._sample(name, now) for name in channels}

    async def write(self, values: Mapping[str, float]) -> None:
        """Send the messages whose signals are named, each once.

        A signal that is not named keeps what was written last, else the DBC file's start value.

        Raises
        ------
        LinkError
            When a channel is not written, a value does not fit its signal, or a message has a
            signal of which nothing is known: nothing was sent.
        LinkDownError
            When the interface does not take a frame. Whether anybody listens, CAN does not say.
        """
        if not values:
            return
        self._check_known(values)
        frames = self._sending.frames(values)
        if not self._keeper.up:
            raise LinkDownError(f"not written: {', '.join(values)}: {self._keeper.down_error()}")
        try:
            self._bus.send(frames)
        except LinkError as error:
            raise type(error)(
                f"link {self.name}: not written: {', '.join(values)}: {error}"
            ) from error

    def _sample(self, name: str, now: float) -> Sample:
        heard = self._of.get(name)
        if heard is None:
            return Sample(_NAN, now, Quality.BAD, f"{name} is only written")
        if heard.fresh:
            heard.work_out()
        sample = heard.values.get(name)
        limit = max(heard.within, heard.every)
        if sample is None or now - sample.time > limit:
            return Sample(_NAN, now, Quality.UNAVAILABLE, self._silence(heard, now))
        return sample

    @staticmethod
    def _silence(heard: Heard, now: float) -> str:
        since = f"for {now - heard.came:.1f} s" if heard.data is not None else "yet"
        return heard.why or f"{heard.name} did not come {since}"

    # Requests

    def _to_ask(self, channels: Sequence[str]) -> list[Heard]:
        now = time.monotonic()
        asked: dict[Heard, None] = {}
        for name in channels:
            heard = self._of.get(name)
            if heard is None or heard.request is None or now - heard.came < heard.every:
                continue
            if heard.failures and heard.refusal(now):
                continue
            if heard.asked_at is not None and now - heard.asked_at < self._config.late_reply_max:
                heard.why = f"{heard.name} may still be answered late"
                continue
            asked[heard] = None
        return list(asked)

    async def _ask(self, asked: Sequence[Heard]) -> None:
        """Send all requests, then wait for all answers, once `timeout`."""
        loop = asyncio.get_running_loop()
        began = time.monotonic()
        for heard in asked:
            heard.asked = True
        self.status.requests += len(asked)
        self._awaited = set(asked)
        answered = self._answered = loop.create_future()
        give_up = loop.call_later(self._config.timeout, _expire, answered)
        try:
            self._bus.send([self._request(heard) for heard in asked])
            await answered
            self.status.round_trip = time.monotonic() - began
        except TimeoutError:
            for heard in list(self._awaited):
                heard.asked_at = began
                self.status.failures += 1
                why = f"{heard.name}: no answer in {self._config.timeout:g} s"
                self._roster.unanswered(heard, why)
        except asyncio.CancelledError:
            for heard in self._awaited:
                heard.asked_at = began
            raise
        finally:
            give_up.cancel()
            self._awaited, self._answered = set(), None

    def _request(self, heard: Heard) -> can.Message:
        import can

        if isinstance(heard.request, RequestConfig):
            request = heard.request
            return can.Message(
                arbitration_id=request.id,
                data=bytes.fromhex(request.data),
                is_extended_id=request.extended,
            )
        return can.Message(
            arbitration_id=heard.message.frame_id,
            is_extended_id=heard.message.is_extended_frame,
            is_remote_frame=True,
            dlc=heard.message.length,
        )

    # What comes

    def _take(self, frame: can.Message, arrived: float) -> None:
        if frame.is_error_frame:
            self._errors.take(frame.arbitration_id, bytes(frame.data))
            return
        heard = self._by_id.get((frame.arbitration_id, frame.is_extended_id))
        if heard is None or frame.is_remote_frame:
            return
        if heard.request is not None and heard not in self._awaited:
            heard.asked_at = None  # late, or unasked: not what is asked for next
            return
        heard.take(bytes(frame.data), arrived)
        self._roster.silent_in_a_row = 0
        if heard.failures or heard.why:
            self._roster.answered(heard)
        if self._awaited:
            self._awaited.discard(heard)
        if not self._awaited and self._answered is not None and not self._answered.done():
            self._answered.set_result(None)

    def _look(self) -> None:
        """Now and then: what has not come for too long?"""
        now = time.monotonic()
        self._errors.forget_old()
        cyclic = [heard for heard in self._heard.values() if heard.request is None]
        silent = [h for h in cyclic if now - max(h.came, self._up_at) > h.within]
        asked = any(heard.request is not None for heard in self._heard.values())
        if cyclic and len(silent) == len(cyclic) and not asked:
            self._keeper.lost(f"connected, and nothing comes: {self._silence(silent[0], now)}")
            return
        for heard in silent:
            heard.why = ""
            heard.why = self._silence(heard, now)
            self._roster.set_apart(heard, heard.why)
        self._watch = asyncio.get_running_loop().call_later(_LOOK, self._look)

    def _show(self) -> None:
        self._roster.show(*filter(None, [self._errors.text]))

    # Connecting

    async def _connect(self) -> None:
        """Open the interface; it is up when something that is expected has come."""
        async with self._turns.lock:
            for heard in self._heard.values():
                heard.clear()
            await self._bus.open()
            await self._first_frame()

    async def _first_frame(self) -> None:
        cyclic = [heard for heard in self._heard.values() if heard.request is None]
        if cyclic:
            self._answered = asyncio.get_running_loop().create_future()
            longest = max(heard.within for heard in cyclic)
            try:
                await asyncio.wait_for(self._answered, longest)
                return
            except TimeoutError:
                if len(cyclic) == len(self._heard):
                    raise LinkTimeoutError(
                        f"the interface is open, and none of its messages came in {longest:g} s"
                    ) from None
            finally:
                self._answered = None
        for heard in self._heard.values():
            if heard.request is not None:
                await self._ask([heard])
                if heard.data is not None:
                    return
        if self._heard:
            raise LinkTimeoutError("the interface is open, and no request is answered")

    def _up(self) -> None:
        self._up_at = time.monotonic()
        self._roster.renew()
        self._watch = asyncio.get_running_loop().call_later(_LOOK, self._look)

    def _disconnect(self) -> None:
        if self._watch is not None:
            self._watch.cancel()
            self._watch = None
        if self._answered is not None and not self._answered.done():
            with contextlib.suppress(asyncio.InvalidStateError):
                self._answered.set_exception(LinkDownError("the interface was closed"))
        self._bus.abandon()

    def _check_known(self, names: Iterable[str]) -> None:
        unknown = [name for name in names if name not in self._config.channels]
        if unknown:
            raise LinkConfigError(
                f"link {self.name} has no channel {', '.join(map(repr, unknown))}; "
                f"there are: {', '.join(self._config.channels)}"
            )

    def _describe(self, name: str) -> str:
        section = self._config.channels[name]
        message = self._messages[section.message]
        signal = signal_of(message, name, section)
        digits = 8 if message.is_extended_frame else 3
        parts = [f"signal {signal.name} of {message.name} ({message.frame_id:0{digits}X}h)"]
        heard = self._of.get(name)
        if section.writable:
            parts.append("written")
        elif heard is not None and heard.request is not None:
            parts.append("requested" + (f" every {heard.every:g} s" if heard.every else ""))
        elif heard is not None:
            parts.append(f"missing after {heard.within:g} s")
        if (section.scale, section.offset) != (1.0, 0.0):
            parts.append(f"× {section.scale:g} + {section.offset:g}")
        if unit := self.info(name).unit:
            parts.append(f"in {unit}")
        return ", ".join(parts)


def _expire(answered: asyncio.Future[None]) -> None:
    if not answered.done():
        answered.set_exception(TimeoutError())
