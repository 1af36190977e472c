"""Writing to a CANopen bus: objects by SDO, one after the other, read back where asked for."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.can.canopen_bus import NodeBus
from drivers.can.canopen_config import CanopenConfig
from drivers.can.expedited import Ask
from drivers.can.objects import encode
from drivers.link import (
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkTimeoutError,
    WriteNotVerifiedError,
)


class Writer:
    """Writes the channels of one link.

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

    async def write(self, values: Mapping[str, float]) -> None:
        """As `drivers.can.canopen_link.CanopenLink.write`."""
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
                f"{self._label}: not written: {left}: {error}{written}"
            ) from error

    def _encoded(self, values: Mapping[str, float]) -> dict[str, bytes]:
        channels = self._config.channels
        fixed = [name for name in values if not channels[name].writable]
        if fixed:
            raise LinkError(
                f"{self._label}: nothing written; not writable: {', '.join(fixed)} "
                "(set writable = true)"
            )
        data: dict[str, bytes] = {}
        for name, value in values.items():
            section = channels[name]
            try:
                number = (value - section.offset) / section.scale
                data[name] = encode(section.number_type, number)
            except ValueError as error:
                raise LinkError(f"{self._label}: nothing written; {name}: {error}") from None
        return data

    async def _write_one(self, name: str, content: bytes) -> None:
        section = self._config.channels[name]
        node = self._bus.node(section.node)
        if not node.prepared:
            raise LinkTimeoutError(node.why or f"{node.name} was not found yet")
        index, subindex = section.object
        if len(content) > 4:
            await self._bus.transfer(
                node, lambda network: network.download(node.number, index, subindex, content)
            )
            found: bytes = content
            if section.verify:
                found = await self._bus.upload(node, index, subindex)
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

    def _ask(self, name: str, data: bytes | None = None) -> Ask:
        section = self._config.channels[name]
        return Ask(self._config.nodes[section.node].id, *section.object, data)


def _kind_of(error: LinkError) -> type[LinkError]:
    """The contract's class of an error, for saying it again with more context."""
    kinds = (LinkDownError, LinkTimeoutError, LinkProtocolError, WriteNotVerifiedError)
    return next((kind for kind in kinds if isinstance(error, kind)), LinkError)
