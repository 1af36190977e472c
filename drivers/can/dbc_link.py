"""A CAN link by DBC file: the last value of each signal that is on the bus, frames sent."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import ClassVar

from drivers.can.dbc_bus import MessageBus
from drivers.can.dbc_config import DbcConfig
from drivers.can.dbc_file import load, signal_of
from drivers.can.interface import check_interface
from drivers.can.sending import Sending
from drivers.link import (
    ChannelInfo,
    Link,
    LinkConfig,
    LinkDownError,
    LinkError,
    Quality,
    Sample,
)

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
        """Unit (the DBC file's by default), whether it is written, time between requests."""
        section = self._config.channels[channel]
        signal = signal_of(self._messages[section.message], channel, section)
        unit = section.unit if section.unit is not None else (signal.unit or "")
        heard = self._bus.of.get(channel)
        every = heard.every if heard is not None and heard.request is not None else 0.0
        return ChannelInfo(unit, section.writable, every)

    async def open(self) -> None:
        """Open the interface and wait for a first frame, or begin to retry.

        Raises
        ------
        LinkConfigError
            When the interface cannot be used on this computer.
        """
        await self._bus.keeper.open()

    async def close(self) -> None:
        """Close the interface."""
        await self._bus.close()

    async def read(self, channels: Sequence[str]) -> dict[str, Sample]:
        """The last value of each signal, with the time at which it came; asks for those that
        have a request.

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
        self._check_known(values, self._config.channels)
        self._in_time(until, values)
        frames = self._sending.frames(values)
        try:
            self._bus.send(frames)
        except LinkError as error:
            kind = LinkDownError if isinstance(error, LinkDownError) else LinkError
            raise kind(f"link {self.name}: not written: {', '.join(values)}: {error}") from error

    def _sample(self, name: str, now: float) -> Sample:
        heard = self._bus.of.get(name)
        if heard is None:
            return Sample(_NAN, now, Quality.BAD, f"{name} is only written")
        return heard.sample(name, now)

    def _describe(self, name: str) -> str:
        section = self._config.channels[name]
        message = self._messages[section.message]
        signal = signal_of(message, name, section)
        digits = 8 if message.is_extended_frame else 3
        parts = [f"signal {signal.name} of {message.name} ({message.frame_id:0{digits}X}h)"]
        heard = self._bus.of.get(name)
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
