"""Frames on their way to a CAN interface: sent at once, or as soon as its queue has room.

A driver's queue is short (Linux: ten frames) and full for a moment when many nodes are asked at
once. That is no fault; that it stays full is (nobody acknowledges, or the adapter hangs).
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from drivers.link import LinkDownError, LinkError

if TYPE_CHECKING:
    import can

    from drivers.can.datagrams import Datagrams

_MOST_UNSENT = 1000
"""Frames that may wait to be sent."""
_PATIENCE = 0.5
"""s for a driver to take a frame."""
_AGAIN = 0.001
"""s between two attempts."""
_FULL = (errno.ENOBUFS, errno.EAGAIN)


class Outgoing:
    """The way out of one open interface.

    Parameters
    ----------
    bus
        python-can's, or what sends in its place.
    prompt
        Whether it sends without waiting for a device, or fails; else a thread sends.
    name
        For the thread.
    on_lost
        Called in the event loop, with the reason, when the interface does not take a frame.
    """

    def __init__(
        self,
        bus: can.BusABC | Datagrams,
        *,
        prompt: bool,
        name: str,
        on_lost: Callable[[str], None],
    ) -> None:
        self._bus = bus
        self._prompt = prompt
        self._on_lost = on_lost
        self._loop = asyncio.get_running_loop()
        self._closed = False
        self.lock = threading.Lock()
        """Held while the interface sends; take it to close that."""
        self._unsent: deque[can.Message] = deque()
        self._full_since = 0.0
        self._again: asyncio.TimerHandle | None = None
        self._queue: queue.SimpleQueue[can.Message | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        if not prompt:
            self._thread = threading.Thread(target=self._transmit, daemon=True, name=f"{name} out")
            self._thread.start()

    def send(self, messages: Sequence[can.Message]) -> None:
        """Send frames, from the event loop; does not wait for the device.

        Raises
        ------
        LinkDownError
            When the interface does not take a frame, ever.
        LinkError
            When too many frames wait already.
        """
        if self._unsent or not self._prompt:
            self._enqueue(messages)
            return
        for i, message in enumerate(messages):
            if not self._try(message):
                self._unsent.extend(messages[i:])
                self._full_since = time.monotonic()
                self._again = self._loop.call_later(_AGAIN, self._retry)
                return

    def _enqueue(self, messages: Sequence[can.Message]) -> None:
        waiting = len(self._unsent) + self._queue.qsize()
        if waiting + len(messages) > _MOST_UNSENT:
            raise LinkError(f"{waiting} frames wait to be sent")
        if self._prompt:
            self._unsent.extend(messages)
        else:
            for message in messages:
                self._queue.put(message)

    def send_and_wait(self, message: can.Message) -> None:
        """Send a frame from a thread that may wait for the device; raises python-can's errors."""
        deadline = time.monotonic() + _PATIENCE
        while True:
            if self._closed:
                raise LinkDownError("the interface is closed")
            try:
                with self.lock:
                    # a prompt one without a time-out: the event loop may be waiting for the lock
                    self._bus.send(message, timeout=0 if self._prompt else _PATIENCE)
                return
            except Exception as error:
                if not _is_full(error) or time.monotonic() > deadline:
                    raise
            time.sleep(_AGAIN)

    def close(self) -> None:
        """Send nothing more; from the event loop."""
        self._closed = True
        if self._again is not None:
            self._again.cancel()
        self._unsent.clear()
        self._queue.put(None)

    def join(self, limit: float) -> None:
        """Wait for the thread, at most so long (s)."""
        if self._thread is not None:
            self._thread.join(limit)

    def _try(self, message: can.Message) -> bool:
        """Send a frame; False when there is no room for it now."""
        try:
            with self.lock:
                self._bus.send(message, timeout=0)
        except Exception as error:
            if _is_full(error):
                return False
            why = f"cannot send: {error}"
            self._lose(why)
            raise LinkDownError(why) from error
        return True

    def _retry(self) -> None:
        with contextlib.suppress(LinkDownError):
            while self._unsent and not self._closed:
                if not self._try(self._unsent[0]):
                    break
                self._unsent.popleft()
                self._full_since = time.monotonic()
        if not self._unsent or self._closed:
            return
        if time.monotonic() - self._full_since > _PATIENCE:
            self._lose(f"cannot send: no room for a frame in {_PATIENCE:g} s")
            return
        self._again = self._loop.call_later(_AGAIN, self._retry)

    def _transmit(self) -> None:
        """Send what waits, in a thread: a driver may take its time."""
        while (message := self._queue.get()) is not None and not self._closed:
            try:
                with self.lock:
                    self._bus.send(message, timeout=_PATIENCE)
            except Exception as error:  # noqa: BLE001 - each interface raises its own
                with contextlib.suppress(RuntimeError):  # the loop has ended
                    self._loop.call_soon_threadsafe(self._lose, f"cannot send: {error}")
                return

    def _lose(self, why: str) -> None:
        if not self._closed:
            self._on_lost(why)


def _is_full(error: BaseException | None) -> bool:
    """Whether a frame was not taken only because others wait in the driver."""
    while error is not None:
        code = getattr(error, "error_code", None) or getattr(error, "errno", None)
        if code in _FULL or str(error) == "Transmit buffer full":  # python-can's socketcan
            return True
        error = error.__cause__
    return False
