"""The CANopen link: encoders, temperature inputs, any object of any node; tables downloaded."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from abbe.drivers import resources
from abbe.drivers.can.canopen.bus import NodeBus
from abbe.drivers.can.canopen.config import CanopenConfig
from abbe.drivers.can.canopen.objects import range_of
from abbe.drivers.can.canopen.reading import CanopenReader
from abbe.drivers.can.canopen.writing import CanopenWriter
from abbe.drivers.can.interface import check_interface, device_of
from abbe.drivers.link import (
    ChannelInfo,
    Link,
    LinkConfig,
    LinkConfigError,
    LinkError,
    Quality,
    Sample,
    WirePlace,
)

if TYPE_CHECKING:
    from abbe.drivers.can.canopen.nodes.node import Node
    from abbe.drivers.can.canopen.sdo.adapter import Network

_NAN = float("nan")


class CanopenLink(Link):
    """One CAN interface and the CANopen nodes on its bus.

    Parameters
    ----------
    name
        The link's name in the configuration.
    config
        Its section.

    Raises
    ------
    LinkConfigError
        When there is no such interface, or a package is missing.
    """

    Config: ClassVar[type[LinkConfig]] = CanopenConfig

    def __init__(self, name: str, config: CanopenConfig) -> None:
        super().__init__(name, config)
        check_interface(config, "canopen")
        self._config = config
        self._bus = NodeBus(name, config, self.status)
        self._reader = CanopenReader(config, self._bus)
        self._writer = CanopenWriter(f"link {name}", config, self._bus)

    @property
    def channels(self) -> Mapping[str, str]:
        """Channel name → node and object, how it is had, and what becomes of it, for people."""
        return {name: self._describe(name) for name in self._config.channels}

    def info(self, channel: str) -> ChannelInfo:
        """Unit, range and step of its type, whether it is written, the time between two reads.

        The decimals of a CiA 404 input, which the device states, are not known here.
        """
        section = self._config.channels[channel]
        low, high, step = range_of(section.number_type)
        if section.profile == "cia404":
            low, high, step = -math.inf, math.inf, 0.0
        low, high = section.range_of(low, high)
        return ChannelInfo(
            section.unit,
            section.writable,
            section.every,
            low,
            high,
            step * abs(section.scale),
            read_back=section.writable,
        )

    def places(self, channel: str) -> tuple[WirePlace, ...]:
        """Its object in the node's dictionary, whether it comes by PDO or by SDO."""
        section = self._config.channels[channel]
        index, subindex = section.object
        first = index << 8 | subindex
        node = f"node {self._config.nodes[section.node].id}"
        return (WirePlace(device_of(self._config), first, first + 1, (node,), (True,)),)

    @property
    def owns(self) -> tuple[str, ...]:
        """The interface."""
        return resources.can(self._config.interface, self._config.channel)

    def keep_together(self, channels: Collection[str], *, one_sample: bool = False) -> None:
        """Channels that come by PDO at one SYNC are of one moment.

        Raises
        ------
        LinkConfigError
            When `one_sample` is asked for and they do not all answer the SYNC of a read.
        """
        self._check_known(channels, self._config.channels)
        sections = self._config.channels
        alone = [name for name in channels if sections[name].by != "pdo"]
        if one_sample and len(channels) > 1 and (alone or self._config.sync != "read"):
            message = f"{', '.join(alone)} by SDO" if alone else f"sync = {self._config.sync!r}"
            raise LinkConfigError(
                f"link {self.name}: {', '.join(channels)} must answer one SYNC: that takes "
                f"by = 'pdo' and sync = 'read'; found {message}"
            )

    async def open(self) -> None:
        """Open the interface and set up the nodes, or begin to retry.

        Raises
        ------
        LinkConfigError
            When the interface cannot be used on this computer.
        """
        await self._bus.open()

    async def close(self) -> None:
        """Close the interface; transfers under way fail."""
        await self._bus.close()

    async def read(self, channels: Sequence[str]) -> dict[str, Sample]:
        """Read channels: one SYNC for all that come by PDO, the nodes in parallel by SDO.

        Raises
        ------
        LinkConfigError
            When a name is not in the configuration.
        """
        self._check_known(channels, self._config.channels)
        try:
            async with self._bus.bus_lock:
                return await self._reader.read(channels)
        except LinkError as error:
            lost = Sample(_NAN, time.monotonic(), Quality.UNAVAILABLE, str(error))
            return dict.fromkeys(channels, lost)

    async def write(self, values: Mapping[str, float], *, until: float = math.inf) -> None:
        """Write objects by SDO, in the order in which they are named, none after `until`.

        Raises
        ------
        LinkError
            When a channel is not writable or a value does not fit: nothing was written.
        LinkTimeoutError, LinkProtocolError, LinkDownError
            When a node did not take it; says which, and what was written before.
        WriteNotVerifiedError
            When the read-back of a channel with ``verify`` differs.
        """
        if values:
            self._check_known(values, self._config.channels)
            await self._writer.write(values, until)

    async def download(self, node: str, index: int, subindex: int, data: bytes) -> bool:
        """Send a table (any long object) to a node by SDO block transfer, checked by its CRC.

        Other nodes are read and written meanwhile.

        Parameters
        ----------
        node
            Its name in the configuration.
        index, subindex
            The object.
        data
            Its content.

        Returns
        -------
        Whether it went by block transfer; else, where the node cannot, in segments.

        Raises
        ------
        LinkError
            When it did not arrive whole; the node was told to drop it.
        """
        found = self._node(node)

        def job(network: Network) -> bool:
            return network.download_block(found.number, index, subindex, data)

        return await self._bus.transfer(found, job)

    async def upload(self, node: str, index: int, subindex: int) -> bytes:
        """Read an object of any length, e.g. to see what a node made of a table.

        Raises
        ------
        LinkError
            When it cannot be had.
        """
        found = self._node(node)
        return await self._bus.upload(found, index, subindex)

    def _node(self, name: str) -> Node:
        if name not in self._config.nodes:
            raise LinkConfigError(
                f"link {self.name} has no node {name!r}; there are: {', '.join(self._config.nodes)}"
            )
        return self._bus.node(name)

    def _describe(self, name: str) -> str:
        section = self._config.channels[name]
        node = self._config.nodes[section.node]
        index, subindex = section.object
        how = "by SDO"
        if section.by == "pdo":
            how = "by PDO at SYNC" if self._config.sync is not None else "by PDO"
        parts = [
            f"node {section.node} ({node.id}) {index:04X}h:{subindex:02X}",
            f"{section.number_type} {how}",
        ]
        if section.every:
            parts.append(f"every {section.every:g} s")
        parts += section.scaling
        if section.unit:
            parts.append(f"in {section.unit}")
        if section.writable:
            parts.append("written, verified" if section.verify else "written")
        return ", ".join(parts)
