"""One CAN bus: opened, read and written without blocking the event loop, watched.

python-can's own asyncio `Notifier` calls ``recv`` from the event loop and catches nothing: when the
interface goes down, the exception ends in the loop's log and no frame comes any more, while
everything looks as before (python-can issues 1865, 1912; 4.6.1). Here any error while receiving
ends the connection and is told; that an adapter falls silent without an error (its supply dips, it
forgets that it was opened) is noticed by the links, which know what should come.
"""

from __future__ import annotations

import asyncio
import contextlib
import queue
import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from drivers.can.interface import (
    PROMPT,
    InterfaceConfig,
    Opened,
    close_interface,
    open_interface,
)
from drivers.link import LinkDownError, LinkError

if TYPE_CHECKING:
    import can

_CLOSE_TIMEOUT = 5.0
_MOST_UNSENT = 1000
"""Frames that may wait to be sent."""
_MOST_AT_ONCE = 64
"""Frames that are taken before others get their turn in the event loop."""
_SEND_TIMEOUT = 0.5
"""s for a driver to take a frame, in the sender's thread."""


class CanBus:
    """One owner of one CAN interface.

    Parameters
    ----------
    config
        Which interface.
    on_frame
        Called in the event loop with every frame and its arrival (monotonic, s).
    on_lost
        Called once in the event loop, with the reason, when the interface is lost; not when it is
        closed.
    """

    def __init__(
        self,
        config: InterfaceConfig,
        on_frame: Callable[[can.Message, float], None],
        on_lost: Callable[[str], None],
    ) -> None:
        self._config = config
        self._on_frame = on_frame
        self._on_lost = on_lost
        self._opened: Opened | None = None
        self._bus: can.BusABC | None = None
        self._fd = -1
        self._send_lock = threading.Lock()
        self._outgoing: queue.Queue[can.Message | None] = queue.Queue(_MOST_UNSENT)
        self._threads: list[threading.Thread] = []
        self._closing: asyncio.Future[None] | None = None

    async def open(self) -> None:
        """Open the interface; an old one is closed first.

        Raises
        ------
        LinkConfigError, LinkDownError
            As `drivers.can.interface.open_interface`.
        """
        await self.close()
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
        self._take(opened)

    def abandon(self) -> None:
        """Close the interface without waiting for it; safe to call at any time."""
        opened, self._opened, self._bus = self._opened, None, None
        if opened is None:
            return
        loop = asyncio.get_running_loop()
        if self._fd >= 0:
            loop.remove_reader(self._fd)
        with contextlib.suppress(queue.Full):
            self._outgoing.put_nowait(None)
        threads, self._threads = self._threads, []
        self._closing = loop.run_in_executor(None, self._end, opened, threads)

    async def close(self) -> None:
        """Close the interface and wait (bounded) until it can be opened again."""
        self.abandon()
        if self._closing is not None:
            await asyncio.wait([self._closing], timeout=_CLOSE_TIMEOUT)
            self._closing = None

    def send(self, messages: Sequence[can.Message]) -> None:
        """Send frames, from the event loop; does not wait for the device.

        Raises
        ------
        LinkDownError
            When the interface is closed, or does not take a frame.
        LinkError
            When too many frames wait already.
        """
        bus = self._bus
        if bus is None:
            raise LinkDownError("the interface is closed")
        if self._config.interface in PROMPT:
            for message in messages:
                try:
                    with self._send_lock:
                        bus.send(message, timeout=0)
                except Exception as error:
                    why = f"cannot send: {error}"
                    self._lose(bus, why)
                    raise LinkDownError(why) from error
            return
        if self._outgoing.qsize() + len(messages) > _MOST_UNSENT:
            raise LinkError(f"{self._outgoing.qsize()} frames wait to be sent")
        for message in messages:
            self._outgoing.put_nowait(message)

    def send_and_wait(self, message: can.Message) -> None:
        """Send a frame from a thread that may wait for the device; raises python-can's errors."""
        bus = self._bus
        if bus is None:
            raise LinkDownError("the interface is closed")
        if self._config.interface not in PROMPT:
            with self._send_lock:
                bus.send(message, timeout=_SEND_TIMEOUT)
            return
        deadline = time.monotonic() + _SEND_TIMEOUT
        while True:
            try:
                # without a time-out: the event loop may be waiting for the lock
                with self._send_lock:
                    bus.send(message, timeout=0)
                return
            except Exception:
                # the queue is full for a moment, when a table is sent
                if time.monotonic() > deadline:
                    raise
            time.sleep(0.001)

    def _take(self, opened: Opened) -> None:
        """Begin to receive and send."""
        loop, bus = asyncio.get_running_loop(), opened.bus
        try:
            self._fd = bus.fileno()
        except NotImplementedError:
            self._fd = -1
        self._opened, self._bus = opened, bus
        self._outgoing = queue.Queue(_MOST_UNSENT)
        work: list[Callable[[can.BusABC], None]] = []
        if self._fd >= 0:
            loop.add_reader(self._fd, self._readable, bus)
        else:
            work.append(self._receive)
        if self._config.interface not in PROMPT:
            work.append(self._transmit)
        self._threads = [
            threading.Thread(
                target=job, args=(bus,), daemon=True, name=f"{self._config.where} {job.__name__}"
            )
            for job in work
        ]
        self._loop = loop
        for thread in self._threads:
            thread.start()

    def _readable(self, bus: can.BusABC) -> None:
        """Take all frames that are there; looking in vain is cheaper than another round."""
        for _ in range(_MOST_AT_ONCE):
            try:
                message = bus.recv(0)
            except Exception as error:  # noqa: BLE001 - each interface raises its own
                self._lose(bus, f"receiving failed: {error}")
                return
            if self._bus is not bus:
                return
            if message is not None:
                self._on_frame(message, time.monotonic())
            elif not self._holds(bus):
                return
        if self._holds(bus):
            # the file descriptor does not show it
            self._loop.call_soon(self._readable, bus)

    def _holds(self, bus: can.BusABC) -> bool:
        """Whether an adapter's port holds bytes that were read already."""
        return bool(getattr(getattr(bus, "serialPortOrig", None), "holds", False))

    def _receive(self, bus: can.BusABC) -> None:
        """As `_readable`, in a thread, for interfaces without a file descriptor."""
        while self._bus is bus:
            try:
                message = bus.recv(0.1)
            except Exception as error:  # noqa: BLE001 - as above
                self._tell(self._lose, bus, f"receiving failed: {error}")
                return
            if message is not None:
                self._tell(self._deliver, bus, message, time.monotonic())

    def _deliver(self, bus: can.BusABC, message: can.Message, arrived: float) -> None:
        if self._bus is bus:
            self._on_frame(message, arrived)

    def _transmit(self, bus: can.BusABC) -> None:
        """Send what waits, in a thread: a driver may take its time."""
        outgoing = self._outgoing
        while (message := outgoing.get()) is not None:
            try:
                with self._send_lock:
                    bus.send(message, timeout=_SEND_TIMEOUT)
            except Exception as error:  # noqa: BLE001 - as above
                self._tell(self._lose, bus, f"cannot send: {error}")
                return

    def _tell(self, function: Callable[..., None], *arguments: object) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(function, *arguments)

    def _lose(self, bus: can.BusABC, why: str) -> None:
        if self._bus is bus:
            self.abandon()
            self._on_lost(why)

    def _end(self, opened: Opened, threads: Sequence[threading.Thread]) -> None:
        for thread in threads:
            thread.join(1.0)
        with self._send_lock:
            close_interface(opened)


def _close_late(opening: asyncio.Future[Opened]) -> None:
    """Close an interface that opened after all."""
    if not opening.cancelled() and opening.exception() is None:
        asyncio.get_running_loop().run_in_executor(None, close_interface, opening.result())
