"""The Modbus link: named channels over one Modbus bus, TCP or RTU.

`ModbusLink` is what the daemon sees: it knows the channels (`abbe.drivers.modbus.config`), has them
read (`abbe.drivers.modbus.reading`) and written (`abbe.drivers.modbus.writing`) on the one bus it
owns (`abbe.drivers.modbus.bus.bus`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar

from abbe.drivers.link import ChannelInfo, Link, LinkConfig, LinkConfigError, Sample, WirePlace
from abbe.drivers.modbus.bus.bus import Bus
from abbe.drivers.modbus.config import ModbusConfig
from abbe.drivers.modbus.places import info_of, owned, place_of
from abbe.drivers.modbus.reading import ModbusReader
from abbe.drivers.modbus.writing import ModbusWriter


class ModbusLink(Link):
    """One Modbus bus and its channels.

    Parameters
    ----------
    name
        The link's name in the configuration.
    config
        Its section.
    """

    Config: ClassVar[type[LinkConfig]] = ModbusConfig

    def __init__(self, name: str, config: ModbusConfig) -> None:
        super().__init__(name, config)
        self._config = config
        self._bus = Bus(name, config, self.status)
        self._reader = ModbusReader(name, config, self._bus)
        self._writer = ModbusWriter(name, config, self._bus)

    @property
    def channels(self) -> Mapping[str, str]:
        """Channel name → where it sits and how it is decoded, for people."""
        return {name: self._describe(name) for name in self._config.channels}

    def info(self, channel: str) -> ChannelInfo:
        """Unit, range and step of its type, whether it is written, the time between two reads."""
        return info_of(self._config, channel)

    def places(self, channel: str) -> tuple[WirePlace, ...]:
        """Its registers or bits on the bus."""
        return (place_of(self._config, channel),)

    @property
    def owns(self) -> tuple[str, ...]:
        """The units behind the TCP address, or the serial line."""
        return owned(self._config, self._config.channels)

    def owns_for(self, channels: Collection[str]) -> tuple[str, ...]:
        """The units of these channels, or the serial line."""
        return owned(self._config, channels)

    def keep_together(self, channels: Collection[str], *, one_sample: bool = False) -> None:
        """Read channels that must be of one moment in one request, as far as they can be.

        Raises
        ------
        LinkConfigError
            When `one_sample` is asked for and they need several requests, or are read at
            different paces.
        """
        self._check_known(channels, self._config.channels)
        requests = self._reader.keep_together(channels)
        paces = {self._config.period_of(name) for name in channels}
        if one_sample and (requests > 1 or len(paces) > 1):
            raise LinkConfigError(
                f"link {self.name}: {', '.join(channels)} must be read in one request, and need "
                f"{requests}: put them into one table of one unit and one block, no more than "
                f"max_gap = {self._config.max_gap} registers apart"
                if requests > 1
                else f"link {self.name}: {', '.join(channels)} must be read in one request, and "
                "belong to blocks that are read at different paces"
            )

    async def open(self) -> None:
        """Connect and get a first answer, or begin to retry in the background."""
        await self._bus.reconnector.open()

    async def close(self) -> None:
        """End the connection and the background task; a request in flight fails."""
        await self._bus.reconnector.close()

    async def read(self, channels: Sequence[str]) -> dict[str, Sample]:
        """Read channels; those of a slow block that is not due come from its last read.

        An outage shows as quality, never as an exception. A call waits at most one time-out for
        a unit that does not answer; two when a second unit falls silent in the same call.

        Parameters
        ----------
        channels
            Names. Hand in the same tuple every time: its requests are planned once.

        Raises
        ------
        LinkConfigError
            When a name is not in the configuration.
        """
        names = channels if type(channels) is tuple else tuple(channels)
        if not self._reader.plans(names):
            self._check_known(names, self._config.channels)
        return await self._reader.read(names)

    async def write(self, values: Mapping[str, float], *, until: float = math.inf) -> None:
        """Write channels: neighbours in one request, requests in the order in which they are named.

        All values are checked before anything is sent: on a value that does not fit, nothing of
        the batch is written.

        Parameters
        ----------
        values
            Channel → value in the channel's unit; rounded to the nearest count for integers.
        until
            Nothing is sent after this moment, monotonic, s.

        Raises
        ------
        LinkError
            When a channel cannot be written or a value does not fit its type.
        LinkDownError, LinkTimeoutError, LinkProtocolError
            When the device did not take it; the message says which channels. After a time-out it
            is unknown whether the device did.
        WriteNotVerifiedError
            When the read-back of a channel with ``verify`` differs.
        """
        if not values:
            return
        names = tuple(values)
        if not self._writer.plans(names):
            self._check_known(names, self._config.channels)
        await self._writer.write(names, values, until)

    def _describe(self, name: str) -> str:
        config = self._config
        channel = config.channels[name]
        parts = [f"unit {config.unit_of(name)} {channel.place}", channel.number_type]
        if channel.width > 1 or channel.order != "ABCD":
            parts[1] += f" {channel.order}"
        parts += channel.scaling
        if channel.unit:
            parts.append(f"in {channel.unit}")
        if every := config.period_of(name):
            parts.append(f"every {every:g} s")
        if channel.writable:
            parts.append("written, verified" if channel.verify else "written")
        return ", ".join(parts)
