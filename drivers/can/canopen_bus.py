"""The one owner of a CANopen bus: its nodes found, set up and watched; SYNC; transfers counted."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

from drivers.can.bus import CanBus
from drivers.can.canopen_config import CanopenConfig
from drivers.can.error_frames import BusErrors
from drivers.can.frames import frame
from drivers.link import (
    LinkConfigError,
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkStatus,
    LinkTimeoutError,
)
from drivers.quarantine import Roster
from drivers.reconnect import Keeper
from drivers.turns import Turns

if TYPE_CHECKING:
    import can

    from drivers.can.canopen_wall import Network
    from drivers.can.expedited import Ask
    from drivers.can.node import Node
    from drivers.can.pdo import Pdo

logger = logging.getLogger("abbe.drivers.can")

T = TypeVar("T")

_LOOK = 0.05
"""s between two looks at heartbeats."""
_SYNC_ID, _NMT_ID = 0x80, 0


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
    """

    def __init__(self, name: str, config: CanopenConfig, status: LinkStatus) -> None:
        self._config = config
        self._status = status
        self.keeper = Keeper(
            f"link {name} ({config.where})",
            config,
            status,
            self._connect,
            self._disconnect,
            logger,
            self._up,
        )
        self.turns = Turns(self.keeper, config.max_waiting)
        self.nodes: dict[str, Node] = {}
        self._bus = CanBus(config, self._take, self.keeper.lost)
        self._errors = BusErrors(self.keeper.lost, self._show)
        self._roster = Roster((), config, self.keeper, logger, "node")
        self._threads: ThreadPoolExecutor | None = None
        self._network: Network | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._awaited: set[Pdo] = set()
        self._synced: asyncio.Future[None] | None = None

    async def open(self) -> None:
        """Make the nodes and connect, or begin to retry.

        Raises
        ------
        LinkConfigError
            When there is no such interface, or a package is missing.
        """
        if not self.nodes:
            self._make_nodes()
        await self.keeper.open()

    async def close(self) -> None:
        """End everything; transfers under way fail."""
        await self.keeper.close()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._bus.close()
        if self._threads is not None:
            self._threads.shutdown(wait=False)
        self.nodes = {}

    def _make_nodes(self) -> None:
        try:
            from drivers.can.canopen_wall import Network
            from drivers.can.node import Node
        except ImportError as error:
            raise LinkConfigError(
                f"CANopen needs the package {error.name}: pip install 'abbe[can]'"
            ) from None
        config = self._config
        self._network = Network(self._bus, config.timeout)
        self._threads = ThreadPoolExecutor(len(config.nodes), "canopen")
        self.nodes = {
            name: Node(name, config, self._network, self._threads, self._changed)
            for name in config.nodes
        }
        self._roster = Roster(self.nodes.values(), config, self.keeper, logger, "node")

    # Transfers

    async def transfer(self, node: Node, job: Callable[[Network], T]) -> T:
        """Do something with a node's objects, and take note of whether it answers.

        Raises
        ------
        LinkError
            As `drivers.can.canopen_wall.Network` raises, or when the node is not to be had now.
        """
        network = self._network
        if network is None or not self.keeper.up:
            raise self.keeper.down_error()
        if not node.prepared:
            raise LinkTimeoutError(node.why or f"{node.name} was not found yet")
        status = self._status
        status.requests += 1
        began = time.monotonic()
        try:
            answer = await node.in_thread(lambda: job(network))
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
            self.keeper.lost(str(error))
            raise
        status.round_trip = time.monotonic() - began
        self._answered(node)
        return answer

    async def ask(self, asked: Mapping[Node, Ask]) -> dict[Node, bytes | LinkError]:
        """Read or write short objects, one of each node, all at once.

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
            raise self.keeper.down_error()
        found: dict[Node, bytes | LinkError] = {}
        held: list[Node] = []
        for node in asked:
            if await node.take_turn():
                held.append(node)
            else:
                found[node] = LinkTimeoutError(f"{node.name} is busy with a longer transfer")
        self._status.requests += len(held)
        began = time.monotonic()
        try:
            answers = await network.ask([asked[node] for node in held])
        except LinkDownError as error:
            self._status.failures += len(held)
            self.keeper.lost(str(error))
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
            else:
                self._answered(node)
        return found

    def _answered(self, node: Node) -> None:
        self._roster.silent_in_a_row = 0
        if node.failures:
            self._roster.answered(node)

    def _unanswered(self, node: Node, error: LinkTimeoutError) -> None:
        node.asked = True
        self._roster.unanswered(node, str(error))
        if node.failures >= self._config.quarantine_after:
            node.lose(node.why)

    # SYNC

    async def sync(self, pdos: Collection[Pdo]) -> None:
        """Send a SYNC and wait, at most one time-out, for the PDOs that answer it.

        Raises
        ------
        LinkDownError
            When it cannot be sent.
        """
        config = self._config
        began = time.monotonic()
        waited_for = {pdo for pdo in pdos if began >= pdo.not_before}
        for pdo in waited_for:
            pdo.awaited_since = began
        self._awaited = waited_for
        synced = self._synced = asyncio.get_running_loop().create_future()
        give_up = asyncio.get_running_loop().call_later(config.timeout, _finish, synced)
        self._status.requests += 1
        try:
            self._bus.send([frame(_SYNC_ID, b"")])
            if waited_for:
                await synced
        finally:
            give_up.cancel()
            self._awaited, self._synced = set(), None
            for pdo in waited_for:
                if pdo.awaited_since is not None:
                    # its answer may still come, and is not to pass for the next one's
                    pdo.not_before = time.monotonic() + config.late_reply_max
        self._status.round_trip = time.monotonic() - began

    async def _sync_for_ever(self, period: float) -> None:

        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            with contextlib.suppress(LinkError):
                self._bus.send([frame(_SYNC_ID, b"")])
            due = max(due + period, loop.time())
            await asyncio.sleep(due - loop.time())

    def _changed(self) -> None:
        """A node said something by itself."""
        if self._synced is not None and not self._synced.done():
            self._awaited = {pdo for pdo in self._awaited if pdo.awaited_since is not None}
            if not self._awaited:
                self._synced.set_result(None)
        self._show()

    # What comes

    def _take(self, message: can.Message, arrived: float) -> None:
        if message.is_error_frame:
            self._errors.take(message.arbitration_id, bytes(message.data))
        elif self._network is not None and not message.is_extended_id:
            self._network.notify(message)

    def _show(self) -> None:
        """Bring the link's state up to date: silent nodes, emergencies, states, bus errors."""
        more = [self._errors.text]
        for node in self.nodes.values():
            more.append(node.emergency)
            if node.prepared and (wrong := node.wrong_state()):
                more.append(wrong)
            more += node.refused.values()
        self._roster.show(*filter(None, more))

    async def _look(self) -> None:
        """Watch heartbeats; reconnect when no node is left; start what fell back."""
        while True:
            await asyncio.sleep(_LOOK)
            self._errors.forget_old()
            now = time.monotonic()
            for node in self.nodes.values():
                limit = node.section.heartbeat
                if node.prepared and limit is not None and now - node.heard > limit:
                    why = f"{node.name}: no heartbeat for {now - node.heard:.1f} s"
                    node.lose(why)
                    self._roster.set_apart(node, why)
                elif node.prepared and node.fell_back():
                    self._start(node)
            if not any(node.prepared for node in self.nodes.values()):
                whys = "; ".join(node.why for node in self.nodes.values())
                self.keeper.lost(f"no node answers: {whys}")
                return

    async def _care_for(self, node: Node) -> None:
        """Look for a node whenever it has to be, less and less often."""
        while True:
            await node.needs_care.wait()
            wait = node.retry_at - time.monotonic()
            if node.failures and wait > 0:
                await asyncio.sleep(min(wait, _LOOK))
                continue
            try:
                await self._prepare(node)
            except LinkDownError as error:
                self.keeper.lost(str(error))
                return
            except LinkTimeoutError as error:
                self._roster.unanswered(node, str(error), bus_silent=False)
                node.needs_care.set()

    async def _prepare(self, node: Node) -> None:
        node.asked = True
        await node.prepare()
        self._start(node)
        if node.failures:
            self._roster.answered(node)
        self._show()

    def _start(self, node: Node) -> None:
        from drivers.can.node import START

        if node.section.start:
            node.started_at = time.monotonic()
            with contextlib.suppress(LinkError):
                self._bus.send([frame(_NMT_ID, bytes((START, node.number)))])

    # Connecting

    async def _connect(self) -> None:
        """Open the interface and set up the nodes; one that answers is enough to be up.

        Raises
        ------
        LinkError
            When the interface does not open or no node answers.
        """
        async with self.turns.lock:
            await self._bus.open()
            for node in self.nodes.values():
                node.renew()
            nodes = list(self.nodes.values())
            found = await asyncio.gather(
                *(self._prepare(node) for node in nodes), return_exceptions=True
            )
            errors = []
            for node, error in zip(nodes, found, strict=True):
                if isinstance(error, LinkTimeoutError):
                    errors.append(error)
                    node.failures = max(node.failures, 1)
                    node.why = str(error)
                    node.needs_care.set()
                elif isinstance(error, BaseException):
                    raise error
            if len(errors) == len(nodes):
                raise LinkTimeoutError(f"the interface is open, and no node answers: {errors[0]}")

    def _up(self) -> None:
        self._roster.renew()
        for node in self.nodes.values():
            if not node.prepared:
                self._roster.set_apart(node, node.why)
        jobs = [self._look(), *(self._care_for(node) for node in self.nodes.values())]
        if isinstance(self._config.sync, float):
            jobs.append(self._sync_for_ever(self._config.sync))
        self._tasks = [asyncio.create_task(job) for job in jobs]
        self._show()

    def _disconnect(self) -> None:
        for task in self._tasks:
            task.cancel()
        closed = LinkDownError("the interface was closed")
        if self._synced is not None and not self._synced.done():
            self._synced.set_exception(closed)
        if self._network is not None:
            self._network.fail(closed)
        self._bus.abandon()


def _finish(synced: asyncio.Future[None]) -> None:
    if not synced.done():
        synced.set_result(None)
