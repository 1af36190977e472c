"""Writing to a CANopen bus: objects by SDO, one after the other, read back where asked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from abbe.drivers.batch import Batch
from abbe.drivers.can.canopen.bus import BusyError, NodeBus
from abbe.drivers.can.canopen.config import CanopenConfig
from abbe.drivers.can.canopen.objects import encode
from abbe.drivers.can.canopen.sdo.errors import SdoAbortError
from abbe.drivers.can.canopen.sdo.expedited import Ask
from abbe.drivers.link import LinkError, LinkTimeoutError, TooLateError, WriteNotVerifiedError

if TYPE_CHECKING:
    from abbe.drivers.can.canopen.nodes.node import Node

_PERHAPS_TAKEN = (0x05040000, 0x06060000, 0x08000000)
"""Abort codes after which nobody knows what the node holds: timed out, hardware, general error."""


class CanopenWriter:
    """The writer of one link's channels.

    Parameters
    ----------
    label
        The link, for people.
    config
        Its section.
    bus
        Its bus.
    """

    def __init__(self, label: str, config: CanopenConfig, bus: NodeBus) -> None:
        self._label = label
        self._config = config
        self._bus = bus

    async def write(self, values: Mapping[str, float], until: float) -> None:
        """As `abbe.drivers.can.canopen.link.CanopenLink.write`."""
        batch = Batch(self._label, values)
        data = self._encoded(values, batch)
        try:
            async with self._bus.bus_lock:
                for name, content in data.items():
                    batch.begin(name)
                    await self._write_one(name, content, until)
                    batch.done()
        except LinkError as error:
            raise batch.failed(error) from error

    def _encoded(self, values: Mapping[str, float], batch: Batch) -> dict[str, bytes]:
        channels = self._config.channels
        fixed = [name for name in values if not channels[name].writable]
        if fixed:
            raise batch.refused(f"not writable: {', '.join(fixed)} (set writable = true)")
        data: dict[str, bytes] = {}
        for name, value in values.items():
            section = channels[name]
            try:
                number = section.number_of(value)
                data[name] = encode(section.number_type, number)
            except ValueError as error:
                raise batch.refused(f"{name}: {error}") from None
        return data

    async def _write_one(self, name: str, content: bytes, until: float) -> None:
        section = self._config.channels[name]
        node = self._bus.node(section.node)
        if not node.prepared:
            why = node.why or f"{node.name} was not found yet"
            raise LinkTimeoutError(why).leaving(untouched=(name,))
        try:
            found = await self._exchanged(name, node, content, until)
        except (TooLateError, BusyError) as error:
            raise error.leaving(untouched=(name,)) from None
        except SdoAbortError as error:
            raise error.leaving(() if error.code in _PERHAPS_TAKEN else (name,)) from None
        if found != content:
            raise WriteNotVerifiedError(
                f"{name}: wrote {content.hex(' ')}, device holds {found.hex(' ')}"
            )

    async def _exchanged(self, name: str, node: Node, content: bytes, until: float) -> bytes:
        """Write an object; hands back what the node holds then, as far as it is asked."""
        section = self._config.channels[name]
        index, subindex = section.object
        if len(content) > 4:
            await self._bus.transfer(
                node,
                lambda network: network.download(node.number, index, subindex, content),
                until,
            )
        else:
            answer = (await self._bus.ask({node: self._ask(name, content)}, until))[node]
            if isinstance(answer, LinkError):
                raise answer
        return await self._read_back(name, node, content) if section.verify else content

    async def _read_back(self, name: str, node: Node, content: bytes) -> bytes:
        found: bytes | LinkError
        if len(content) > 4:
            try:
                found = await self._bus.upload(node, *self._config.channels[name].object)
            except LinkError as error:
                found = error
        else:
            found = (await self._bus.ask({node: self._ask(name)}))[node]
        if isinstance(found, LinkError):
            raise WriteNotVerifiedError(
                f"{name}: wrote {content.hex(' ')}, and it cannot be read back: {found}"
            )
        return found

    def _ask(self, name: str, data: bytes | None = None) -> Ask:
        section = self._config.channels[name]
        return Ask(self._config.nodes[section.node].id, *section.object, data)
