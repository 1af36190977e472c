"""The CANopen link: encoders, temperature inputs, any object of any node; tables downloaded."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from drivers.can.canopen_bus import NodeBus
from drivers.can.canopen_config import CanopenConfig
from drivers.can.expedited import Ask
from drivers.can.objects import encode
from drivers.can.sdo_errors import TooLongError
from drivers.link import (
    ChannelInfo,
    Link,
    LinkConfig,
    LinkConfigError,
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkTimeoutError,
    Quality,
    Sample,
    WriteNotVerifiedError,
)

if TYPE_CHECKING:
    from drivers.can.canopen_wall import Network
    from drivers.can.node import Node
    from drivers.can.pdo import Pdo

logger = logging.getLogger("abbe.drivers.can")

_NAN = float("nan")


class CanopenLink(Link):
    """One CAN interface and the CANopen nodes on its bus.

    Parameters
    ----------
    name
        The link's name in the configuration.
    config
        Its section.
    """

    Config: ClassVar[type[LinkConfig]] = CanopenConfig

    def __init__(self, name: str, config: CanopenConfig) -> None:
        super().__init__(name, config)
        self._config = config
        self._bus = NodeBus(name, config, self.status)
        self._last: dict[str, Sample] = {}
        self._epoch = 0

    @property
    def channels(self) -> Mapping[str, str]:
        """Channel name → node and object, how it is had, and what becomes of it, for people."""
        return {name: self._describe(name) for name in self._config.channels}

    def info(self, channel: str) -> ChannelInfo:
        """Unit, whether it is written, and the time between two reads."""
        section = self._config.channels[channel]
        return ChannelInfo(section.unit, section.writable, section.every)

    async def open(self) -> None:
        """Open the interface and set up the nodes, or begin to retry.

        Raises
        ------
        LinkConfigError
            When there is no such interface, or a package is missing.
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
        self._check_known(channels)
        bus = self._bus
        try:
            async with bus.turns:
                if bus.keeper.epoch != self._epoch:
                    self._epoch = bus.keeper.epoch
                    self._last.clear()
                await self._read_all(channels)
                if not bus.keeper.up:
                    raise bus.keeper.down_error()
                last = self._last
                return {name: last[name] for name in channels}
        except LinkError as error:
            lost = Sample(_NAN, time.monotonic(), Quality.UNAVAILABLE, str(error))
            return dict.fromkeys(channels, lost)

    async def write(self, values: Mapping[str, float]) -> None:
        """Write objects by SDO, in the order in which they are named.

        Raises
        ------
        LinkError
            When a channel is not writable or a value does not fit: nothing was written.
        LinkTimeoutError, LinkProtocolError, LinkDownError
            When a node did not take it; says which, and what was written before.
        WriteNotVerifiedError
            When the read-back of a channel with ``verify`` differs.
        """
        if not values:
            return
        self._check_known(values)
        data = self._encoded(values)
        done: list[str] = []
        try:
            async with self._bus.turns:
                for name, content in data.items():
                    await self._write_one(name, content)
                    done.append(name)
        except LinkError as error:
            left = ", ".join(name for name in values if name not in done)
            written = f"; written before: {', '.join(done)}" if done else ""
            raise _kind_of(error)(
                f"link {self.name}: not written: {left}: {error}{written}"
            ) from error

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
        return await self._bus.transfer(
            found, lambda network: network.upload(found.number, index, subindex)
        )

    # Reading

    async def _read_all(self, names: Sequence[str]) -> None:
        by_sdo: dict[Node, list[str]] = {}
        by_pdo: dict[str, Pdo] = {}
        now = time.monotonic()
        for name in dict.fromkeys(names):
            section = self._config.channels[name]
            node = self._bus.nodes[section.node]
            if (gone := node.unavailable(name)) is not None:
                self._last[name] = gone
            elif section.by == "sdo":
                if self._is_due(name, section.every, now):
                    by_sdo.setdefault(node, []).append(name)
            elif (pdo := node.pdo_of(name)) is not None:
                by_pdo[name] = pdo
        if by_pdo:
            await self._read_pdos(by_pdo)
        if by_sdo:
            await self._read_objects(by_sdo)

    def _is_due(self, name: str, every: float, now: float) -> bool:
        last = self._last.get(name)
        return last is None or last.quality is Quality.UNAVAILABLE or now - last.time >= every

    async def _read_objects(self, wanted: Mapping[Node, list[str]]) -> None:
        """All nodes at once, each node's objects one after the other."""
        left = {node: list(names) for node, names in wanted.items()}
        while left:
            names = {node: queue.pop(0) for node, queue in left.items()}
            asked = {node: self._ask(name) for node, name in names.items()}
            answers = await self._bus.ask(asked)
            now = time.monotonic()
            for node, name in names.items():
                answer = answers[node]
                if isinstance(answer, bytes):
                    self._last[name] = node.sample(name, answer, now)
                elif isinstance(answer, LinkProtocolError):
                    self._last[name] = Sample(_NAN, now, Quality.BAD, f"{name}: {answer}")
                    if isinstance(answer, TooLongError):
                        await self._read_long(node, name)
                else:
                    # whoever does not answer is not asked for more
                    lost = Sample(_NAN, now, Quality.UNAVAILABLE, str(answer))
                    self._last |= dict.fromkeys([name, *left[node]], lost)
                    left[node] = []
            left = {node: queue for node, queue in left.items() if queue}

    def _ask(self, name: str, data: bytes | None = None) -> Ask:
        section = self._config.channels[name]
        return Ask(self._config.nodes[section.node].id, *section.object, data)

    async def _read_long(self, node: Node, name: str) -> None:
        index, subindex = self._config.channels[name].object
        try:
            data = await self.upload(self._config.channels[name].node, index, subindex)
        except LinkError as error:
            kind = Quality.BAD if isinstance(error, LinkProtocolError) else Quality.UNAVAILABLE
            self._last[name] = Sample(_NAN, time.monotonic(), kind, f"{name}: {error}")
        else:
            self._last[name] = node.sample(name, data, time.monotonic())

    async def _read_pdos(self, wanted: Mapping[str, Pdo]) -> None:
        if self._config.sync == "read":
            began = time.monotonic()
            await self._bus.sync(set(wanted.values()))
        else:
            began = float("-inf")
        now = time.monotonic()
        for name, pdo in wanted.items():
            section = self._config.channels[name]
            node = self._bus.nodes[section.node]
            if pdo.came < began:
                self._last[name] = self._no_answer(name, node, pdo)
            elif began == float("-inf") and now - pdo.came > section.within:
                since = f"for {now - pdo.came:.1f} s" if pdo.data is not None else "yet"
                why = f"{name}: TPDO{pdo.number} of {node.name} did not come {since}"
                self._last[name] = Sample(_NAN, now, Quality.UNAVAILABLE, why)
            else:
                self._last[name] = node.from_pdo(name, pdo)

    @staticmethod
    def _no_answer(name: str, node: Node, pdo: Pdo) -> Sample:
        why = f"{name}: TPDO{pdo.number} of {node.name} did not answer SYNC"
        if wrong := node.wrong_state():
            why += f": {wrong}"
        return Sample(_NAN, time.monotonic(), Quality.UNAVAILABLE, why)

    # Writing

    def _encoded(self, values: Mapping[str, float]) -> dict[str, bytes]:
        channels = self._config.channels
        fixed = [name for name in values if not channels[name].writable]
        if fixed:
            raise LinkError(
                f"link {self.name}: nothing written; not writable: {', '.join(fixed)} "
                "(set writable = true)"
            )
        data: dict[str, bytes] = {}
        for name, value in values.items():
            section = channels[name]
            try:
                number = (value - section.offset) / section.scale
                data[name] = encode(section.number_type, number)
            except ValueError as error:
                raise LinkError(f"link {self.name}: nothing written; {name}: {error}") from None
        return data

    async def _write_one(self, name: str, content: bytes) -> None:
        section = self._config.channels[name]
        node = self._node(section.node)
        if not node.prepared:
            raise LinkTimeoutError(node.why or f"{node.name} was not found yet")
        index, subindex = section.object
        if len(content) > 4:
            await self._bus.transfer(
                node, lambda network: network.download(node.number, index, subindex, content)
            )
            found: bytes = content
            if section.verify:
                found = await self.upload(section.node, index, subindex)
        else:
            answer = (await self._bus.ask({node: self._ask(name, content)}))[node]
            if section.verify and isinstance(answer, bytes):
                answer = (await self._bus.ask({node: self._ask(name)}))[node]
            if isinstance(answer, LinkError):
                raise answer
            found = answer
        if found != content:
            raise WriteNotVerifiedError(
                f"{name}: wrote {content.hex(' ')}, device holds {found.hex(' ')}"
            )

    def _node(self, name: str) -> Node:
        if name not in self._config.nodes:
            raise LinkConfigError(
                f"link {self.name} has no node {name!r}; there are: {', '.join(self._config.nodes)}"
            )
        node = self._bus.nodes.get(name)
        if node is None:
            raise self._bus.keeper.down_error()
        return node

    def _check_known(self, names: Iterable[str]) -> None:
        unknown = [name for name in names if name not in self._config.channels]
        if unknown:
            raise LinkConfigError(
                f"link {self.name} has no channel {', '.join(map(repr, unknown))}; "
                f"there are: {', '.join(self._config.channels)}"
            )

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
        if (section.scale, section.offset) != (1.0, 0.0):
            parts.append(f"× {section.scale:g} + {section.offset:g}")
        if section.unit:
            parts.append(f"in {section.unit}")
        if section.writable:
            parts.append("written, verified" if section.verify else "written")
        return ", ".join(parts)


def _kind_of(error: LinkError) -> type[LinkError]:
    """The contract's class of an error, for saying it again with more context."""
    kinds = (LinkDownError, LinkTimeoutError, LinkProtocolError, WriteNotVerifiedError)
    return next((kind for kind in kinds if isinstance(error, kind)), LinkError)
