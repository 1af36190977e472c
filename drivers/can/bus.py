"""One CAN bus: its interface opened, read and written without blocking the event loop, closed."""

from __future__ import annotations

import asyncio
import logging
import math
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

from abbe.drivers.can.datagrams import Datagrams, group_of
from abbe.drivers.can.incoming import Incoming
from abbe.drivers.can.interface import (
    PROMPT,
    STAMPED,
    InterfaceConfig,
    Opened,
    close_interface,
    open_interface,
)
from abbe.drivers.can.outgoing import Outgoing
from abbe.drivers.can.slcan_port import BufferedPort
from abbe.drivers.can.slcan_status import AdapterStatus
from abbe.drivers.link import LinkDownError

if TYPE_CHECKING:
    import can

logger = logging.getLogger("abbe.drivers.can")

_CLOSE_TIMEOUT = 5.0
_END_OF_THREAD = 1.0
"""s for a thread to end; one that hangs in a driver is left behind."""


class _Connection(NamedTuple):
    """One opening of the interface."""

    opened: Opened
    datagrams: Datagrams | None
    incoming: Incoming
    outgoing: Outgoing
    status: AdapterStatus | None


class CanBus:
    """One owner of one CAN interface.

    Parameters
    ----------
    config
        Which interface.
    on_frame
        Called in the event loop with every frame, the earliest and the latest moment at which it
        can have arrived (monotonic, s).
    on_lost
        Called once in the event loop, with the reason, when the interface is lost; not when it is
        closed.
    on_state
        Called in the event loop when an adapter tells its controller's state: in words (none when
        all is well), and whether it has left the bus.
    """

    def __init__(
        self,
        config: InterfaceConfig,
        on_frame: Callable[[can.Message, float, float], None],
        on_lost: Callable[[str], None],
        on_state: Callable[[str, bool], None],
    ) -> None:
        self._config = config
        self._on_frame = on_frame
        self._on_lost = on_lost
        self._on_state = on_state
        self._connection: _Connection | None = None
        self._closing: asyncio.Future[None] | None = None

    async def open(self) -> None:
        """Open the interface; an old one is closed first.

        Raises
        ------
        LinkConfigError, LinkDownError
            As `abbe.drivers.can.interface.open_interface`.
        """
        await self.close()
        since = time.monotonic()
        loop = asyncio.get_running_loop()
        opening = loop.run_in_executor(None, open_interface, self._config)
        try:
            opened = await asyncio.wait_for(asyncio.shield(opening), self._config.open_timeout)
        except TimeoutError:
            opening.add_done_callback(_close_late)
            raise LinkDownError(
                f"{self._config.where} does not open in {self._config.open_timeout:g} s"
            ) from None
        except asyncio.CancelledError:
            opening.add_done_callback(_close_late)
            raise
        self._take(opened, since)

    def _take(self, opened: Opened, since: float) -> None:
        """Begin to receive and send."""
        config = self._config

        def lose(why: str) -> None:
            if self._connection is not None and self._connection.opened is opened:
                self.abandon()
                self._on_lost(why)

        datagrams = None
        if config.interface == "udp_multicast":
            datagrams = Datagrams(opened.bus, group_of(config))
        incoming = Incoming(
            datagrams or opened.bus,
            stamped=config.interface in STAMPED,
            name=config.where,
            since=since,
            on_frame=self._on_frame,
            on_lost=lose,
        )
        outgoing = Outgoing(
            datagrams or opened.bus,
            prompt=config.interface in PROMPT,
            name=config.where,
            on_lost=lose,
        )
        port = getattr(opened.bus, "serialPortOrig", None)
        status = None
        if isinstance(port, BufferedPort):
            dialect = config.adapter_status
            status = AdapterStatus(port, outgoing.lock, dialect, self._on_state, lose)
        self._connection = _Connection(opened, datagrams, incoming, outgoing, status)

    def abandon(self) -> None:
        """Close the interface without waiting for it; safe to call at any time."""
        connection, self._connection = self._connection, None
        if connection is None:
            return
        connection.incoming.close()
        connection.outgoing.close()
        if connection.status is not None:
            connection.status.close()
        closed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._closing = closed
        _in_background(lambda: _end(connection), closed)

    async def close(self) -> None:
        """Close the interface and wait (bounded) until it can be opened again."""
        self.abandon()
        if self._closing is not None:
            await asyncio.wait([self._closing], timeout=_CLOSE_TIMEOUT)
            self._closing = None

    def send(self, messages: Sequence[can.Message], until: float = math.inf) -> None:
        """Send frames, from the event loop; as `abbe.drivers.can.outgoing.Outgoing.send`."""
        connection = self._connection or self._open_one()
        connection.outgoing.send(messages, until)

    async def send_in_time(self, message: can.Message, until: float) -> None:
        """Send a frame and see it leave; as `abbe.drivers.can.outgoing.Outgoing.send_in_time`."""
        await self._open_one().outgoing.send_in_time(message, until)

    def drain(self) -> None:
        """Take in now what has come already: it is no answer to what is asked next."""
        if self._connection is not None:
            self._connection.incoming.drain()

    def wait(self, seconds: float) -> bool:
        """Wait on the spot for frames; as `abbe.drivers.can.incoming.Incoming.wait`."""
        return self._connection is not None and self._connection.incoming.wait(seconds)

    def send_and_wait(self, message: can.Message) -> None:
        """Send a frame from a thread that may wait for the device; raises python-can's errors."""
        self._open_one().outgoing.send_and_wait(message)

    def is_bus_off(self) -> bool:
        """Whether the interface says that its controller has left the bus; few of them do."""
        if self._connection is None:
            return False
        from can import BusState

        try:
            return self._connection.opened.bus.state is BusState.ERROR
        except Exception:  # noqa: BLE001 - each interface raises its own; it is lost soon enough
            return False

    def _open_one(self) -> _Connection:
        connection = self._connection
        if connection is None:
            raise LinkDownError("the interface is closed")
        return connection


def _end(connection: _Connection) -> None:
    connection.incoming.join(_END_OF_THREAD)
    connection.outgoing.join(_END_OF_THREAD)
    if connection.datagrams is not None:
        connection.datagrams.close()
    lock = connection.outgoing.lock
    held = lock.acquire(timeout=_END_OF_THREAD)
    try:
        close_interface(connection.opened)
    finally:
        if held:
            lock.release()


def _close_late(opening: asyncio.Future[Opened]) -> None:
    """Close an interface that opened after all."""
    if not opening.cancelled() and opening.exception() is None:
        opened = opening.result()
        _in_background(lambda: close_interface(opened))


def _in_background(work: Callable[[], None], done: asyncio.Future[None] | None = None) -> None:
    """Do what may take a while in a thread of its own.

    Not in the event loop's executor: where the loop is just ending that takes nothing any more, and
    a port would stay locked.
    """
    loop = asyncio.get_running_loop()

    def wake() -> None:
        if done is not None and not done.done():
            done.set_result(None)

    def run() -> None:
        try:
            work()
        except Exception as error:  # noqa: BLE001 - each interface raises its own; it is closed now
            logger.debug("closing a CAN interface: %s", error)
        finally:
            with suppress(RuntimeError):  # the loop has ended; nobody waits
                loop.call_soon_threadsafe(wake)

    threading.Thread(target=run, name="close CAN interface").start()
