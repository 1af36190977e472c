"""A serial port that has no file descriptor: two threads with bounded queues serve it."""

from __future__ import annotations

import asyncio
import contextlib
import queue
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from abbe.drivers.link import LinkDownError, LinkError
from abbe.drivers.serial.port.port import CLOSE_TIMEOUT

if TYPE_CHECKING:
    from serial import SerialBase

_MOST_WRITES = 64
_MOST_UNREAD = 16
"""Pieces (of at most 4 KiB) that may wait for the event loop; then the reader waits."""


class ThreadedPort:
    """A `Port` for pyserial's ``rfc2217://``, ``loop://`` and the like.

    Parameters
    ----------
    opened
        The port, with a time-out so that a read ends now and then.
    since
        Monotonic time in s before which nothing came.
    on_data, on_lost
        As in `abbe.drivers.serial.port.opening.open_port`; called in the event loop.
    """

    def __init__(
        self,
        opened: SerialBase,
        since: float,
        on_data: Callable[[bytes], None],
        on_lost: Callable[[str], None],
    ) -> None:
        self._opened = opened
        self._on_data = on_data
        self._on_lost = on_lost
        self._loop = asyncio.get_running_loop()
        self._ended = threading.Event()
        self._outgoing: queue.Queue[bytes] = queue.Queue(_MOST_WRITES)
        self._room = threading.Semaphore(_MOST_UNREAD)
        self._unsent = 0
        self._since = since
        self._closing: asyncio.Future[None] | None = None
        self._threads = [
            threading.Thread(target=work, daemon=True, name=f"serial {work.__name__}")
            for work in (self._read, self._write)
        ]
        for thread in self._threads:
            thread.start()

    def write(self, data: bytes) -> None:
        """Queue bytes.

        Raises
        ------
        LinkError
            When too much waits already.
        LinkDownError
            When the port is gone.
        """
        if self._closing is not None:
            raise LinkDownError("the port is closed")
        try:
            self._outgoing.put_nowait(data)
        except queue.Full:
            raise LinkError(
                f"{self._unsent} bytes wait to be sent: the device stopped us"
            ) from None
        self._unsent += len(data)

    def drain(self) -> bool:
        """Nothing to do: what the reader has is on its way already."""
        return True

    def discard(self) -> None:
        """Forget what waits here; what pyserial is just sending cannot be called back."""
        with contextlib.suppress(queue.Empty):
            while True:
                self._unsent -= len(self._outgoing.get_nowait())

    @property
    def since(self) -> float:
        """Monotonic time in s before which nothing came of what is being handed over."""
        return self._since

    def wait(self, seconds: float) -> bool:
        """Not to be waited for on the spot: what comes, comes by the event loop."""
        return False

    @property
    def unsent(self) -> int:
        """Bytes not yet handed to pyserial."""
        return self._unsent

    def close(self) -> None:
        """End the threads and the port; safe to call twice."""
        if self._closing is None:
            self._ended.set()
            self._closing = self._loop.run_in_executor(None, self._close)

    async def closed(self) -> None:
        """Wait (bounded) for the end."""
        if self._closing is not None:
            await asyncio.wait([self._closing], timeout=CLOSE_TIMEOUT)

    def _close(self) -> None:
        with contextlib.suppress(OSError):
            self._opened.close()
        for thread in self._threads:
            thread.join(CLOSE_TIMEOUT / 2)

    def _read(self) -> None:
        empty_at = self._since
        while not self._ended.is_set():
            since = empty_at
            try:
                data = self._opened.read(1)
                if data:
                    data += self._opened.read(min(getattr(self._opened, "in_waiting", 0), 4096))
                looked = time.monotonic()
                if not getattr(self._opened, "in_waiting", 1):
                    empty_at = looked
            except Exception as error:  # noqa: BLE001 - each handler of pyserial has its own
                self._tell(self._lose, f"the port was lost: {error}")
                return
            if not data:
                continue
            while not self._room.acquire(timeout=0.1):
                if self._ended.is_set():
                    return
            self._tell(self._deliver, data, since)

    def _write(self) -> None:
        while not self._ended.is_set():
            try:
                data = self._outgoing.get(timeout=0.1)
            except queue.Empty:
                continue
            try:
                self._opened.write(data)
            except Exception as error:  # noqa: BLE001 - as above
                self._tell(self._lose, f"the port was lost: {error}")
                return
            self._tell(self._sent, len(data))

    def _tell(self, function: Callable[..., None], *arguments: object) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(function, *arguments)

    def _deliver(self, data: bytes, since: float) -> None:
        self._room.release()
        self._since = since
        if self._closing is None:
            self._on_data(data)

    def _sent(self, count: int) -> None:
        self._unsent -= count

    def _lose(self, why: str) -> None:
        if self._closing is None:
            self.close()
            self._on_lost(why)
