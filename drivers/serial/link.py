"""The serial link: named channels over one serial port, asked for or sent by themselves."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar

from abbe.drivers import resources
from abbe.drivers.link import (
    ChannelInfo,
    Link,
    LinkConfig,
    LinkConfigError,
    LinkError,
    Sample,
    WirePlace,
)
from abbe.drivers.serial.asking import AskedLine
from abbe.drivers.serial.checksum import shown
from abbe.drivers.serial.config import SerialConfig
from abbe.drivers.serial.streaming import StreamingLine


class SerialLink(Link):
    """One serial port and its channels.

    Parameters
    ----------
    name
        The link's name in the configuration.
    config
        Its section.
    """

    Config: ClassVar[type[LinkConfig]] = SerialConfig

    def __init__(self, name: str, config: SerialConfig) -> None:
        super().__init__(name, config)
        self._config = config
        self._known = frozenset(config.channels)
        kind = StreamingLine if config.streaming else AskedLine
        self._line: AskedLine | StreamingLine = kind(
            f"link {name} ({config.port})", config, self.status
        )

    @property
    def channels(self) -> Mapping[str, str]:
        """Channel name → in which message, which field, and what becomes of it, for people."""
        return {name: self._describe(name) for name in self._config.channels}

    def info(self, channel: str) -> ChannelInfo:
        """Unit, range and step where its form has them, whether it is written, how often asked."""
        section = self._config.channels[channel]
        every = 0.0 if section.message is None else self._config.messages[section.message].every
        low, high, step = section.range
        return ChannelInfo(section.unit, section.writable, every, low, high, step)

    def places(self, channel: str) -> tuple[WirePlace, ...]:
        """The field of the answer, or the command: two commands that read alike are one place.

        Whether a query asks for what a command sets, no text says.
        """
        section = self._config.channels[channel]
        if section.message is None:
            space = ("command", str(section.command))
        else:
            query = self._config.messages[section.message].query
            said = f"message {section.message}" if query is None else f"answer to {query}"
            space = (said, self._config.field_of(channel))
        devices = self.owns or (self._config.port,)
        return tuple(WirePlace(device, space=space, apart=(True, True)) for device in devices)

    @property
    def owns(self) -> tuple[str, ...]:
        """The port."""
        return resources.serial(self._config.port)

    def keep_together(self, channels: Collection[str], *, one_sample: bool = False) -> None:
        """Channels of one message always are of one moment.

        Raises
        ------
        LinkConfigError
            When `one_sample` is asked for and they are of several messages.
        """
        self._check_known(channels, self._config.channels)
        messages = dict.fromkeys(self._config.channels[name].message for name in channels)
        if one_sample and len(messages) > 1:
            named = ", ".join(message or "none" for message in messages)
            raise LinkConfigError(
                f"link {self.name}: {', '.join(channels)} must be of one answer, and are of "
                f"several messages ({named}): a device that sends them all in one line is needed"
            )

    async def open(self) -> None:
        """Open the port and get a first answer (or message), or begin to retry."""
        await self._line.reconnector.open()

    async def close(self) -> None:
        """Close the port; a query in flight fails."""
        await self._line.close()

    async def read(self, channels: Sequence[str]) -> dict[str, Sample]:
        """Read channels: one query for all channels of a message; what streams is at hand.

        Raises
        ------
        LinkConfigError
            When a name is not in the configuration.
        """
        if not self._known.issuperset(channels):
            self._check_known(channels, self._config.channels)
        return await self._line.read(channels)

    async def write(self, values: Mapping[str, float], *, until: float = math.inf) -> None:
        """Send the channels' commands in order, none after `until` (monotonic, s).

        Raises
        ------
        LinkError
            When a channel is not written by a command, or a value was not taken.
        """
        if not values:
            return
        self._check_known(values, self._config.channels)
        fixed = [name for name in values if not self._config.channels[name].writable]
        if fixed:
            raise LinkError(
                f"link {self.name}: nothing written; not writable: {', '.join(fixed)} "
                "(they have no command)"
            ).leaving(untouched=values)
        await self._line.write(values, until)

    def _describe(self, name: str) -> str:
        config, channel = self._config, self._config.channels[name]
        if channel.message is None:
            parts = [f"command {shown((channel.command or '').encode())}"]
            parts += ["acknowledged" if channel.acknowledge is not None else "not acknowledged"]
        else:
            message = config.messages[channel.message]
            field = config.field_of(name)
            if message.query is None:
                parts = [f"field {field} of message {channel.message}, sent by itself"]
            else:
                parts = [f"field {field} of the answer to {shown(message.query.encode())}"]
                if message.every:
                    parts.append(f"every {message.every:g} s")
            if message.checksum is not None:
                parts.append(f"{message.checksum.kind} checked")
        parts += channel.scaling
        if channel.unit:
            parts.append(f"in {channel.unit}")
        return ", ".join(parts)
