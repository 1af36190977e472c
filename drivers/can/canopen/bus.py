"""The one owner of a CANopen bus: opened, its nodes cared for, transfers counted, state shown."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

from abbe.drivers.bus_lock import BusLock
from abbe.drivers.can.bus import CanBus
from abbe.drivers.can.canopen.config import CanopenConfig
from abbe.drivers.can.canopen.nodes.care import NodeCare
from abbe.drivers.can.canopen.process_data.sync import SYNC_ID, Sync
from abbe.drivers.can.error_frames import LEFT_THE_BUS, BusErrors
from abbe.drivers.can.interface import LINUX_ERRORS
from abbe.drivers.link import (
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkStatus,
    LinkTimeoutError,
    TooLateError,
)
from abbe.drivers.quarantine import MemberHealth
from abbe.drivers.reconnect import Reconnector

if TYPE_CHECKING:
    import can

    from abbe.drivers.can.canopen.nodes.node import Node
    from abbe.drivers.can.canopen.sdo.adapter import Network
    from abbe.drivers.can.canopen.sdo.expedited import Ask

logger = logging.getLogger("abbe.drivers.can")

T = TypeVar("T")


class BusyError(LinkTimeoutError):
    """Nothing was sent: a longer transfer of the node is under way."""


class NodeBus:
    """A CAN interface with CANopen nodes on its bus.

    Parameters
    ----------
    name
        The link's name, for the log.
    config
        Its section.
    status
        Kept up to date.

    Attributes
    ----------
    nodes
        By name; empty before `open`.
    sync
        Its SYNC.
    """

    def __init__(self, name: str, config: CanopenConfig, status: LinkStatus) -> None:
        self._config = config
        self._status = status
        self.reconnector = Reconnector(
            f"link {name} ({config.where})",
            config,
            status,
            self._connect,
            self._disconnect,
            logger,
            self._up,
        )
        self.bus_lock = BusLock(self.reconnector, config.max_waiting)
        self.nodes: dict[str, Node] = {}
        self._errors = BusErrors(
            self.reconnector.lost, self._show, linux=config.interface in LINUX_ERRORS
        )
        self._bus = CanBus(config, self._take, self.reconnector.lost, self._errors.state)
        self.sync = Sync(self._bus, config, status)
        self._health = MemberHealth((), config, self.reconnector, logger, "node")
        self._threads: ThreadPoolExecutor | None = None
        self._network: Network | None = None
        self._care: NodeCare | None = None

    async def open(self) -> None:
        """Make the nodes and connect, or begin to retry.

        Raises
        ------
        LinkConfigError
            When the interface cannot be used on this computer.
        """
        if not self.nodes:
            self._make_nodes()
        await self.reconnector.open()

    def node(self, name: str) -> Node:
        """A node of the configuration.

        Raises
        ------
        LinkDownError
            When the bus is not open.
        """
        if name not in self.nodes:
            raise self.reconnector.down_error()
        return self.nodes[name]

    async def close(self) -> None:
        """End everything; transfers under way fail."""
        await self.reconnector.close()
        if self._care is not None:
            await self._care.ended()
        await self._bus.close()
        if self._threads is not None:
            self._threads.shutdown(wait=False)
        self.nodes, self._care = {}, None

    def _make_nodes(self) -> None:
        from abbe.drivers.can.canopen.nodes.node import Node
        from abbe.drivers.can.canopen.sdo.adapter import Network

        config = self._config
        self._network = Network(self._bus, config.timeout)
        self._threads = ThreadPoolExecutor(len(config.nodes), "canopen")
        self.nodes = {
            name: Node(name, config, self._network, self._threads, self._show, self.sync)
            for name in config.nodes
        }
        nodes = self.nodes.values()
        self._health = MemberHealth(nodes, config, self.reconnector, logger, "node")
        self._care = NodeCare(
            nodes, self._bus, self._health, self.reconnector, self._look, self._show
        )

    # Transfers

    async def transfer(self, node: Node, job: Callable[[Network], T], until: float = math.inf) -> T:
        """Do something with a node's objects, and take note of whether it answers.

        Parameters
        ----------
        node
            Whose.
        job
            What, in a thread.
        until
            Monotonic time in s after which it is not begun.

        Raises
        ------
        TooLateError
            When it was not.
        LinkError
            As `abbe.drivers.can.canopen.sdo.adapter.Network` raises, or when the node is not to
            be had now.
        """
        network = self._network
        if network is None or not self.reconnector.up:
            raise self.reconnector.down_error()
        if not node.prepared:
            raise LinkTimeoutError(node.why or f"{node.name} was not found yet")
        status = self._status
        status.requests += 1
        began = time.monotonic()

        def in_time() -> T:
            if time.monotonic() > until:
                raise TooLateError("too old before it could be sent, so not sent")
            return job(network)

        try:
            answer = await node.in_thread(in_time)
        except LinkProtocolError:
            status.failures += 1
            self._answered(node)
            raise
        except LinkTimeoutError as error:
            status.failures += 1
            self._unanswered(node, error)
            raise
        except LinkDownError as error:
            status.failures += 1
            self.reconnector.lost(str(error))
            raise
        status.round_trip = time.monotonic() - began
        self._answered(node)
        return answer

    async def upload(self, node: Node, index: int, subindex: int) -> bytes:
        """Read an object of any length.

        Raises
        ------
        LinkError
            As `transfer`.
        """
        return await self.transfer(
            node, lambda network: network.upload(node.number, index, subindex)
        )

    async def ask(
        self, asked: Mapping[Node, Ask], until: float = math.inf
    ) -> dict[Node, bytes | LinkError]:
        """Read or write short objects, one of each node, all at once; not after `until`.

        Returns
        -------
        What was read (or written), or why it was not, by node.

        Raises
        ------
        LinkDownError
            When the bus is gone.
        """
        network = self._network
        if network is None:
            raise self.reconnector.down_error()
        found: dict[Node, bytes | LinkError] = {}
        held: list[Node] = []
        for node in asked:
            if await node.take_turn():
                held.append(node)
            else:
                found[node] = BusyError(f"{node.name} is busy with a longer transfer")
        self._status.requests += len(held)
        began = time.monotonic()
        try:
            answers = await network.ask([asked[node] for node in held], until)
        except LinkDownError as error:
            self._status.failures += len(held)
            self.reconnector.lost(str(error))
            raise
        finally:
            for node in held:
                node.end_turn()
        self._status.round_trip = time.monotonic() - began
        for node, answer in zip(held, answers, strict=True):
            found[node] = answer
            if isinstance(answer, LinkError):
                self._status.failures += 1
            if isinstance(answer, LinkTimeoutError):
                self._unanswered(node, answer)
            elif not isinstance(answer, TooLateError):
                self._answered(node)
        return found

    def _answered(self, node: Node) -> None:
        self._health.silent_in_a_row = 0
        if node.failures:
            self._health.answered(node)

    def _unanswered(self, node: Node, error: LinkTimeoutError) -> None:
        node.asked = True
        self._health.unanswered(node, str(error))
        if node.failures >= self._config.quarantine_after:
            node.lose(node.why)

    # What comes

    def _take(self, message: can.Message, arrived: float, latest: float) -> None:
        if message.is_error_frame:
            self._errors.take(message.arbitration_id, bytes(message.data))
        elif self._network is not None and not message.is_extended_id:
            if message.arbitration_id == SYNC_ID:
                self.sync.went(arrived)
            else:
                self._network.notify(message, arrived, latest)

    def _show(self) -> None:
        """Bring the link's state up to date: silent nodes, emergencies, states, bus errors."""
        more = [self._errors.text]
        for node in self.nodes.values():
            more.append(node.emergency)
            if node.prepared and (wrong := node.wrong_state()):
                more.append(wrong)
            more += node.refused.values()
        self._health.show(*filter(None, more))

    def _look(self) -> None:
        self._errors.forget_old()
        if self._bus.is_bus_off():
            self.reconnector.lost(LEFT_THE_BUS)

    # Connecting

    async def _connect(self) -> None:
        """Open the interface and set up the nodes; one that answers is enough to be up.

        Raises
        ------
        LinkError
            When the interface does not open or no node answers.
        """
        async with self.bus_lock.lock:
            self._errors.renew()
            await self._bus.open()
            if self._care is None:
                return
            try:
                await self._care.find_all()
            except LinkTimeoutError as error:
                raise self._errors.explained(error) from None

    def _up(self) -> None:
        if self._care is None:
            return
        period = self._config.sync
        jobs = [self.sync.send_for_ever(period)] if isinstance(period, float) else []
        self._care.begin(*jobs)
        self._show()

    def _disconnect(self) -> None:
        if self._care is not None:
            self._care.end()
        closed = LinkDownError("the interface was closed")
        self.sync.fail(closed)
        if self._network is not None:
            self._network.fail(closed)
        self._bus.abandon()
