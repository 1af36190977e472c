"""A CAN link by DBC file: the last value of each signal that is on the bus, frames sent."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from abbe.drivers import resources
from abbe.drivers.batch import Batch
from abbe.drivers.can.dbc.bus import MessageBus
from abbe.drivers.can.dbc.config import DbcConfig
from abbe.drivers.can.dbc.file import bits_of, load, page_of, range_of, signal_of
from abbe.drivers.can.dbc.sending import Sending
from abbe.drivers.can.interface import check_interface, device_of
from abbe.drivers.link import (
    ChannelInfo,
    Link,
    LinkConfig,
    LinkConfigError,
    LinkError,
    Quality,
    Sample,
    TooLateError,
    WirePlace,
)

if TYPE_CHECKING:
    import can

_NAN = float("nan")


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
        When there is no such interface, the DBC file cannot be read, or lacks a message or signal.
    """

    Config: ClassVar[type[LinkConfig]] = DbcConfig

    def __init__(self, name: str, config: DbcConfig) -> None:
        super().__init__(name, config)
        check_interface(config, "cantools")
        self._config = config
        self._known = frozenset(config.channels)
        self._messages = load(config)
        self._bus = MessageBus(name, config, self._messages, self.status)
        self._sending = Sending(name, config, self._messages)

    @property
    def channels(self) -> Mapping[str, str]:
        """Channel name → message and signal, and what becomes of it, for people."""
        return {name: self._describe(name) for name in self._config.channels}

    def info(self, channel: str) -> ChannelInfo:
        """Unit and range (the DBC file's), step, whether it is written, time between requests."""
        section = self._config.channels[channel]
        signal = signal_of(self._messages[section.message], channel, section)
        unit = section.unit if section.unit is not None else (signal.unit or "")
        received = self._bus.of.get(channel)
        every = (
            received.pace.every if received is not None and received.request is not None else 0.0
        )
        low, high, step = range_of(signal)
        low, high = section.range_of(low, high)
        return ChannelInfo(unit, section.writable, every, low, high, step * abs(section.scale))

    def places(self, channel: str) -> tuple[WirePlace, ...]:
        """Its bits in the frames of that id, byte by byte."""
        section = self._config.channels[channel]
        message = self._messages[section.message]
        signal = signal_of(message, channel, section)
        space = [f"frame {message.frame_id:X}h{' extended' if message.is_extended_frame else ''}"]
        if (page := page_of(message, signal.name)) is not None:
            space.append("page {} {}".format(*page))
        return tuple(
            WirePlace(device_of(self._config), first, end, tuple(space), (True,) * len(space))
            for first, end in bits_of(signal)
        )

    @property
    def owns(self) -> tuple[str, ...]:
        """The interface."""
        return resources.can(self._config.interface, self._config.channel)

    def goes_with(self, channel: str) -> frozenset[str]:
        """What is written in the same message."""
        if not self._config.channels[channel].writable:
            return frozenset((channel,))
        return self._sending.goes_with(channel)

    def keep_together(self, channels: Collection[str], *, one_sample: bool = False) -> None:
        """Signals of one frame always are of one moment.

        Raises
        ------
        LinkConfigError
            When `one_sample` is asked for and they are in several messages, or on several pages.
        """
        self._check_known(channels, self._config.channels)
        frames = dict.fromkeys(self._frame_of(name) for name in channels)
        if one_sample and len(frames) > 1:
            raise LinkConfigError(
                f"link {self.name}: {', '.join(channels)} must be of one frame, and are of several "
                f"({', '.join(frames)})"
            )

    def _frame_of(self, name: str) -> str:
        section = self._config.channels[name]
        message = self._messages[section.message]
        page = page_of(message, signal_of(message, name, section).name)
        return message.name if page is None else "{} {} {}".format(message.name, *page)

    async def open(self) -> None:
        """Open the interface and wait for a first frame, or begin to retry.

        Raises
        ------
        LinkConfigError
            When the interface cannot be used on this computer.
        """
        await self._bus.reconnector.open()

    async def close(self) -> None:
        """Close the interface."""
        await self._bus.close()

    async def read(self, channels: Sequence[str]) -> dict[str, Sample]:
        """The last value of each signal, with the earliest moment at which it can have been taken:
        its frame's arrival, or, for those that have a request, when that left.

        Raises
        ------
        LinkConfigError
            When a name is not in the configuration.
        """
        if not self._known.issuperset(channels):
            self._check_known(channels, self._config.channels)
        try:
            await self._bus.ask_for(channels)
        except LinkError as error:
            lost = Sample(_NAN, time.monotonic(), Quality.UNAVAILABLE, str(error))
            return dict.fromkeys(channels, lost)
        now = time.monotonic()
        return {name: self._sample(name, now) for name in channels}

    async def write(self, values: Mapping[str, float], *, until: float = math.inf) -> None:
        """Send the messages whose signals are named, each once, none after `until`.

        Signals that no channel writes have the DBC file's start value.

        Raises
        ------
        LinkError
            When a channel is not written, a value does not fit its signal, a message has a signal
            of which nothing is known, or carries another channel that is not named
            (`goes_with`): nothing was sent.
        LinkDownError
            When the interface does not take a frame. Whether anybody listens, CAN does not say.
        TooLateError
            When it did not take it in time.
        """
        if not values:
            return
        self._check_known(values, self._config.channels)
        frames = self._sending.frames(values)
        batch = Batch(f"link {self.name}", values)
        try:
            for names, frame in frames:
                batch.begin(*names)
                await self._send(names, frame, until)
                batch.done()
        except LinkError as error:
            raise batch.failed(error) from error

    async def _send(self, names: Collection[str], frame: can.Message, until: float) -> None:
        try:
            await self._bus.send(frame, until)
        except TooLateError as error:
            raise error.leaving(untouched=names) from None

    def _sample(self, name: str, now: float) -> Sample:
        received = self._bus.of.get(name)
        if received is None:
            return Sample(_NAN, now, Quality.BAD, f"{name} is only written")
        return received.sample(name, now)

    def _describe(self, name: str) -> str:
        section = self._config.channels[name]
        message = self._messages[section.message]
        signal = signal_of(message, name, section)
        digits = 8 if message.is_extended_frame else 3
        parts = [f"signal {signal.name} of {message.name} ({message.frame_id:0{digits}X}h)"]
        received = self._bus.of.get(name)
        if section.writable:
            parts.append("written")
        elif received is not None and received.request is not None:
            parts.append(
                "requested" + (f" every {received.pace.every:g} s" if received.pace.every else "")
            )
        elif received is not None:
            parts.append(f"missing after {received.within:g} s")
        parts += section.scaling
        if unit := self.info(name).unit:
            parts.append(f"in {unit}")
        return ", ".join(parts)
