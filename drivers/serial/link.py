"""The serial link: named channels over one serial port, asked for or sent by themselves."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

from drivers.link import ChannelInfo, Link, LinkConfig, LinkError, Sample
from drivers.serial.asking import AskedLine
from drivers.serial.checksum import shown
from drivers.serial.config import SerialConfig
from drivers.serial.streaming import StreamingLine


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
        """Unit, whether it is written, and the time between two queries."""
        section = self._config.channels[channel]
        every = 0.0 if section.message is None else self._config.messages[section.message].every
        return ChannelInfo(section.unit, section.writable, every)

    async def open(self) -> None:
        """Open the port and get a first answer (or message), or begin to retry."""
        await self._line.keeper.open()

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
        """Send the channels' commands in order.

        Raises
        ------
        LinkError
            When a channel is not written by a command, or a value was not taken.
        """
        if not values:
            return
        self._check_known(values, self._config.channels)
        self._in_time(until, values)
        fixed = [name for name in values if not self._config.channels[name].writable]
        if fixed:
            raise LinkError(
                f"link {self.name}: nothing written; not writable: {', '.join(fixed)} "
                "(they have no command)"
            )
        await self._line.write(values)

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
        if (channel.scale, channel.offset) != (1.0, 0.0):
            parts.append(f"× {channel.scale:g} + {channel.offset:g}")
        if channel.unit:
            parts.append(f"in {channel.unit}")
        return ", ".join(parts)
