"""The one owner of a bus that a DBC file describes: messages received, and missing ones."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from abbe.drivers.bus_lock import BusLock
from abbe.drivers.can.bus import CanBus
from abbe.drivers.can.dbc.config import DbcConfig
from abbe.drivers.can.dbc.received_message import ReceivedMessage
from abbe.drivers.can.dbc.requests import Requests
from abbe.drivers.can.error_frames import LEFT_THE_BUS, BusErrors
from abbe.drivers.can.interface import LINUX_ERRORS
from abbe.drivers.link import LinkDownError, LinkStatus, LinkTimeoutError
from abbe.drivers.quarantine import MemberHealth
from abbe.drivers.reconnect import Reconnector

if TYPE_CHECKING:
    import can
    from cantools.database.can import Message

logger = logging.getLogger("abbe.drivers.can")

_LOOK = 0.05
"""s between two looks at what has not come."""


class MessageBus:
    """A CAN interface and the messages on its bus.

    Parameters
    ----------
    name
        The link's name, for the log.
    config
        Its section.
    messages
        The DBC file's that are used, by name.
    status
        Kept up to date.

    Attributes
    ----------
    of
        Channel → the message that it is read from; channels that are only written have none.
    """

    def __init__(
        self, name: str, config: DbcConfig, messages: Mapping[str, Message], status: LinkStatus
    ) -> None:
        self._received = [
            received
            for message in messages.values()
            if (received := ReceivedMessage(message, config)).channels
        ]
        self._cyclic = [received for received in self._received if received.request is None]
        self._by_id = {
            (received.message.frame_id, received.message.is_extended_frame): received
            for received in self._received
        }
        self.of = {
            channel: received for received in self._received for channel in received.channels
        }
        self.reconnector = Reconnector(
            f"link {name} ({config.where})",
            config,
            status,
            self._connect,
            self._disconnect,
            logger,
            self._up,
        )
        self._errors = BusErrors(
            self.reconnector.lost, self._show, linux=config.interface in LINUX_ERRORS
        )
        self._bus = CanBus(config, self._take, self.reconnector.lost, self._errors.state)
        self._health = MemberHealth(self._received, config, self.reconnector, logger, "message")
        self._bus_lock = BusLock(self.reconnector, config.max_waiting)
        self._requests = Requests(self._bus, config, self._health, status)
        self._first: asyncio.Future[None] | None = None
        self._watch: asyncio.TimerHandle | None = None
        self._up_at = 0.0

    async def close(self) -> None:
        """Close the interface."""
        await self.reconnector.close()
        await self._bus.close()

    async def ask_for(self, channels: Iterable[str]) -> None:
        """Ask for those of the channels' messages that have a request.

        Raises
        ------
        LinkError
            When the bus is down, or too many wait for it. Silence is none: the samples show it.
        """
        asked = self._requests.due([self.of[name] for name in channels if name in self.of])
        if asked:
            async with self._bus_lock:
                await self._requests.ask(asked)
        if not self.reconnector.up:
            raise self.reconnector.down_error()

    async def send(self, frame: can.Message, until: float) -> None:
        """Send a frame, not after `until` (monotonic, s).

        Raises
        ------
        TooLateError
            When it was too late before the interface took it.
        LinkError
            When the interface does not take it.
        """
        if not self.reconnector.up:
            raise self.reconnector.down_error()
        await self._bus.send_in_time(frame, until)

    # What comes

    def _take(self, frame: can.Message, arrived: float, latest: float) -> None:
        if frame.is_error_frame:
            self._errors.take(frame.arbitration_id, bytes(frame.data))
            return
        if frame.is_remote_frame:
            return
        received = self._by_id.get((frame.arbitration_id, frame.is_extended_id))
        if received is None:
            return
        if received.request is not None and not self._requests.is_awaited(received, latest):
            return
        asked_at = None if received.request is None else self._requests.asked_at
        received.take(bytes(frame.data), arrived, asked_at)
        self._health.silent_in_a_row = 0
        if received.failures or received.why:
            self._health.answered(received)
        if received.request is not None:
            self._requests.took(received)
        elif self._first is not None and not self._first.done():
            self._first.set_result(None)

    def _look_later(self) -> None:
        due = time.monotonic() + _LOOK
        self._watch = asyncio.get_running_loop().call_later(_LOOK, self._look, due)

    def _look(self, due: float) -> None:
        """Now and then: what has not come for too long?"""
        now = time.monotonic()
        self._look_later()
        if now - due > _LOOK:
            return  # it was us who were stalled: what has come is to be taken in first
        self._errors.forget_old()
        if self._bus.is_bus_off():
            self.reconnector.lost(LEFT_THE_BUS)
            return
        silent = [h for h in self._cyclic if now - max(h.came, self._up_at) > h.within]
        if silent and len(silent) == len(self._received):
            self.reconnector.lost(f"connected, and nothing comes: {silent[0].silence(now)}")
            return
        for received in silent:
            received.why = ""
            received.why = received.silence(now)
            self._health.set_apart(received, received.why)

    def _show(self) -> None:
        self._health.show(*filter(None, [self._errors.text]))

    # Connecting

    async def _connect(self) -> None:
        """Open the interface; it is up when something that is expected has come."""
        async with self._bus_lock.lock:
            for received in self._received:
                received.clear()
            self._errors.renew()
            await self._bus.open()
            try:
                await self._first_frame()
            except LinkTimeoutError as error:
                raise self._errors.explained(error) from None

    async def _first_frame(self) -> None:
        if self._cyclic:
            self._first = asyncio.get_running_loop().create_future()
            longest = max(received.within for received in self._cyclic)
            try:
                await asyncio.wait_for(self._first, longest)
                return
            except TimeoutError:
                if len(self._cyclic) == len(self._received):
                    raise LinkTimeoutError(
                        f"the interface is open, and none of its messages came in {longest:g} s"
                    ) from None
            finally:
                self._first = None
        for received in self._received:
            if received.request is not None:
                await self._requests.ask([received])
                if received.data is not None:
                    return
        if self._received:
            raise LinkTimeoutError("the interface is open, and no request is answered")

    def _up(self) -> None:
        self._up_at = time.monotonic()
        self._health.renew()
        self._show()
        self._look_later()

    def _disconnect(self) -> None:
        if self._watch is not None:
            self._watch.cancel()
            self._watch = None
        closed = LinkDownError("the interface was closed")
        if self._first is not None and not self._first.done():
            self._first.set_exception(closed)
        self._requests.fail(closed)
        self._bus.abandon()
