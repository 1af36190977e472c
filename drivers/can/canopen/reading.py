"""Reading a CANopen bus: PDOs at one SYNC or as they come, the nodes in parallel by SDO."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from abbe.drivers.can.canopen.bus import NodeBus
from abbe.drivers.can.canopen.config import CanopenChannelConfig, CanopenConfig
from abbe.drivers.can.canopen.sdo.errors import TooLongError
from abbe.drivers.can.canopen.sdo.expedited import Ask
from abbe.drivers.link import LinkError, LinkProtocolError, Quality, Sample
from abbe.drivers.pace import Pace

if TYPE_CHECKING:
    from abbe.drivers.can.canopen.nodes.node import Node
    from abbe.drivers.can.canopen.process_data.pdo import Pdo

_NAN = float("nan")


class CanopenReader:
    """The reader of one link's channels; keeps their last samples.

    Parameters
    ----------
    config
        The link's section.
    bus
        Its bus.
    """

    def __init__(self, config: CanopenConfig, bus: NodeBus) -> None:
        self._config = config
        self._bus = bus
        self._last: dict[str, Sample] = {}
        self._paces = {name: Pace(section.every) for name, section in config.channels.items()}
        self._known: dict[tuple[str, ...], list[tuple[str, Node, CanopenChannelConfig]]] = {}
        self._epoch = 0

    async def read(self, names: Sequence[str]) -> dict[str, Sample]:
        """As `abbe.drivers.link.Link.read`; the caller has the turn.

        Raises
        ------
        LinkDownError
            When the bus is gone.
        """
        bus = self._bus
        if bus.reconnector.epoch != self._epoch:
            self._epoch = bus.reconnector.epoch
            self._last.clear()
            self._known.clear()
        wanted = tuple(names)
        by_sdo: dict[Node, list[str]] = {}
        by_pdo: list[tuple[str, Node, Pdo]] = []
        now = time.monotonic()
        for name, node, section in self._known.get(wanted) or self._find(wanted):
            if (gone := node.unavailable(name)) is not None:
                self._last[name] = gone
            elif section.by == "sdo":
                if self._is_due(name, now):
                    by_sdo.setdefault(node, []).append(name)
            elif (pdo := node.pdo_of(name)) is not None:
                by_pdo.append((name, node, pdo))
        if by_pdo:
            await self._read_pdos(by_pdo)
        if by_sdo:
            await self._read_objects(by_sdo)
        if not bus.reconnector.up:
            raise bus.reconnector.down_error()
        last = self._last
        return {name: last[name] for name in names}

    def _find(self, names: tuple[str, ...]) -> list[tuple[str, Node, CanopenChannelConfig]]:
        """Each channel once, with its node; kept for the next time."""
        channels, nodes = self._config.channels, self._bus.nodes
        sections = {name: channels[name] for name in names}
        found = self._known[names] = [(n, nodes[s.node], s) for n, s in sections.items()]
        return found

    def _is_due(self, name: str, now: float) -> bool:
        last = self._last.get(name)
        unknown = last is None or last.quality is Quality.UNAVAILABLE
        return unknown or self._paces[name].is_due(now)

    def _keep(self, name: str, sample: Sample) -> None:
        self._last[name] = sample
        self._paces[name].asked(sample.time, good=sample.good)

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
                    self._keep(name, node.sample(name, answer, asked[node].left))
                elif isinstance(answer, LinkProtocolError):
                    self._keep(name, Sample(_NAN, now, Quality.BAD, f"{name}: {answer}"))
                    if isinstance(answer, TooLongError):
                        await self._read_long(node, name)
                else:
                    # whoever does not answer is not asked for more
                    lost = Sample(_NAN, now, Quality.UNAVAILABLE, str(answer))
                    self._last |= dict.fromkeys([name, *left[node]], lost)
                    left[node] = []
            left = {node: queue for node, queue in left.items() if queue}

    def _ask(self, name: str) -> Ask:
        section = self._config.channels[name]
        return Ask(self._config.nodes[section.node].id, *section.object)

    async def _read_long(self, node: Node, name: str) -> None:
        index, subindex = self._config.channels[name].object
        began = time.monotonic()
        try:
            data = await self._bus.upload(node, index, subindex)
        except LinkError as error:
            kind = Quality.BAD if isinstance(error, LinkProtocolError) else Quality.UNAVAILABLE
            self._keep(name, Sample(_NAN, began, kind, f"{name}: {error}"))
        else:
            self._keep(name, node.sample(name, data, began))

    async def _read_pdos(self, wanted: Sequence[tuple[str, Node, Pdo]]) -> None:
        last = self._last
        if self._config.sync == "read":
            began = time.monotonic()
            await self._bus.sync.ask({pdo for _, _, pdo in wanted})
            for name, node, pdo in wanted:
                came = pdo.came >= began
                last[name] = node.from_pdo(name, pdo) if came else self._no_answer(name, node, pdo)
            return
        now = time.monotonic()
        for name, node, pdo in wanted:
            if now - pdo.taken <= self._config.channels[name].within:
                last[name] = node.from_pdo(name, pdo)
            else:
                since = f"for {now - pdo.came:.1f} s" if pdo.data is not None else "yet"
                why = f"{name}: TPDO{pdo.number} of {node.name} did not come {since}"
                last[name] = Sample(_NAN, now, Quality.UNAVAILABLE, why)

    @staticmethod
    def _no_answer(name: str, node: Node, pdo: Pdo) -> Sample:
        why = f"{name}: TPDO{pdo.number} of {node.name} did not answer SYNC"
        if wrong := node.wrong_state():
            why += f": {wrong}"
        return Sample(_NAN, time.monotonic(), Quality.UNAVAILABLE, why)
