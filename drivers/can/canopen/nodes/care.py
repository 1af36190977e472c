"""The care for a CANopen bus's nodes: found, set up, started, their heartbeats watched."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Collection, Coroutine
from typing import TYPE_CHECKING, Any

from abbe.drivers.can.bus import CanBus
from abbe.drivers.can.frames import frame
from abbe.drivers.link import LinkDownError, LinkError, LinkTimeoutError
from abbe.drivers.quarantine import MemberHealth
from abbe.drivers.reconnect import Reconnector

if TYPE_CHECKING:
    from abbe.drivers.can.canopen.nodes.node import Node

logger = logging.getLogger("abbe.drivers.can")

_LOOK = 0.05
"""s between two looks at heartbeats."""
_NMT_ID, _START = 0, 1
_FIRST_PAUSE, _LAST_PAUSE = 0.25, 60.0
"""s before a node is asked again for what it refused; doubles from the first to the last."""


class NodeCare:
    """Cares for nodes while their bus is up.

    Parameters
    ----------
    nodes
        All of them.
    bus
        Where NMT commands go.
    health
        Keeps count of who answers.
    reconnector
        The bus's connection; reported lost when no node is left.
    on_look
        Called at every look.
    on_change
        Called when what the link shows may have changed.
    """

    def __init__(
        self,
        nodes: Collection[Node],
        bus: CanBus,
        health: MemberHealth,
        reconnector: Reconnector,
        on_look: Callable[[], None],
        on_change: Callable[[], None],
    ) -> None:
        self._nodes = nodes
        self._bus = bus
        self._health = health
        self._reconnector = reconnector
        self._on_look = on_look
        self._on_change = on_change
        self._tasks: list[asyncio.Task[None]] = []

    async def find_all(self) -> None:
        """Set up all nodes, on a new connection; one that answers is enough.

        Raises
        ------
        LinkError
            When none does, or the bus is gone.
        """
        for node in self._nodes:
            node.renew()
        nodes = list(self._nodes)
        found = await asyncio.gather(
            *(self._prepare(node) for node in nodes), return_exceptions=True
        )
        errors = []
        for node, error in zip(nodes, found, strict=True):
            if isinstance(error, LinkDownError):
                raise error
            if isinstance(error, LinkError):
                errors.append(error)
                node.failures = max(node.failures, 1)
                node.why = str(error)
                node.needs_care.set()
            elif isinstance(error, BaseException):
                raise error
        if len(errors) == len(nodes):
            raise LinkTimeoutError(f"the interface is open, and no node answers: {errors[0]}")

    def begin(self, *more: Coroutine[Any, Any, None]) -> None:
        """Watch from now on; `more` runs besides until `end`."""
        self._health.renew()
        for node in self._nodes:
            if not node.prepared:
                self._health.set_apart(node, node.why)
        jobs = [self._watch(), *(self._care_for(node) for node in self._nodes), *more]
        self._tasks = [asyncio.create_task(job) for job in jobs]
        for task in self._tasks:
            task.add_done_callback(self._ended)

    def end(self) -> None:
        """Watch no more; safe to call twice."""
        for task in self._tasks:
            task.cancel()

    async def ended(self) -> None:
        """Wait for what `end` ended."""
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _ended(self, task: asyncio.Task[None]) -> None:
        """A watch that ended by an error must not look like one that has nothing to report."""
        error = None if task.cancelled() else task.exception()
        if error is not None:
            logger.error("%s: watching its nodes failed", self._reconnector.label, exc_info=error)
            self._reconnector.lost(f"watching its nodes failed: {type(error).__name__}: {error}")

    async def _watch(self) -> None:
        """Watch heartbeats; reconnect when no node is left; start what fell back."""
        while True:
            due = time.monotonic() + _LOOK
            await asyncio.sleep(_LOOK)
            now = time.monotonic()
            if now - due > _LOOK:
                continue  # it was us who were stalled: what has come is to be taken in first
            self._on_look()
            for node in self._nodes:
                limit = node.section.heartbeat
                if node.prepared and limit is not None and now - node.last_heartbeat_at > limit:
                    why = f"{node.name}: no heartbeat for {now - node.last_heartbeat_at:.1f} s"
                    node.lose(why)
                    self._health.set_apart(node, why)
                elif node.prepared and node.fell_back():
                    self._start(node)
            if not any(node.prepared for node in self._nodes):
                whys = "; ".join(node.why for node in self._nodes)
                self._reconnector.lost(f"no node answers: {whys}")
                return

    async def _care_for(self, node: Node) -> None:
        """Look for a node whenever it has to be, less and less often."""
        while True:
            await self._until_needed(node)
            wait = node.retry_at - time.monotonic()
            if node.failures and wait > 0:
                await asyncio.sleep(min(wait, _LOOK))
                continue
            try:
                await self._prepare(node)
            except LinkDownError as error:
                self._reconnector.lost(str(error))
                return
            except LinkError as error:
                self._health.unanswered(node, str(error), bus_silent=False)
                node.needs_care.set()

    async def _until_needed(self, node: Node) -> None:
        """Wait until a node needs care; meanwhile ask again, less and less, for what it refused.

        A node that refuses something while it boots is not to be without it until it boots again.
        """
        pause = _FIRST_PAUSE
        while True:
            limit = pause if node.prepared and node.refused else None
            try:
                await asyncio.wait_for(node.needs_care.wait(), limit)
                return
            except TimeoutError:
                pause = min(2.0 * pause, _LAST_PAUSE)
            try:
                await node.ask_again()
            except LinkDownError as error:
                self._reconnector.lost(str(error))
            except LinkError:
                continue  # whether it answers at all is seen by those who read it
            self._on_change()

    async def _prepare(self, node: Node) -> None:
        node.asked = True
        await node.prepare()
        self._start(node)
        if node.failures:
            self._health.answered(node)
        self._on_change()

    def _start(self, node: Node) -> None:
        if node.section.start:
            node.started_at = time.monotonic()
            with contextlib.suppress(LinkError):
                self._bus.send([frame(_NMT_ID, bytes((_START, node.number)))])
