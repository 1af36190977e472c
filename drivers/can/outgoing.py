"""Transmission to a CAN interface: at once, as soon as its queue has room, or never.

A driver's queue is short (Linux: ten frames) and full for a moment when many nodes are asked at
once. That is no fault; that it stays full is (nobody acknowledges, or the adapter hangs). What has
become too old while it waited here is dropped.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import math
import queue
import threading
import time
from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from abbe.drivers.link import LinkDownError, LinkError, TooLateError

if TYPE_CHECKING:
    from collections.abc import Callable

    import can

    from abbe.drivers.can.datagrams import Datagrams
    from abbe.drivers.can.slcan_port import BufferedPort

_MOST_UNSENT = 1000
"""Frames that may wait to be sent."""
_PATIENCE = 0.5
"""s for a driver to take a frame."""
_AGAIN = 0.001
"""s between two attempts."""
_FULL = (errno.ENOBUFS, errno.EAGAIN)
_CLOSED = "the interface is closed"


class _Waiting(NamedTuple):
    """A frame that waits: until when (monotonic, s), and who waits with it."""

    message: can.Message
    until: float = math.inf
    sent: asyncio.Future[None] | None = None

    @property
    def unwanted(self) -> bool:
        """Whether whoever wanted it has gone."""
        return self.sent is not None and self.sent.done()

    def tell(self, error: Exception | None = None) -> None:
        """Say what became of it, from the event loop."""
        if self.sent is None or self.sent.done():
            return
        if error is None:
            self.sent.set_result(None)
        else:
            self.sent.set_exception(error)


class Outgoing:
    """Transmission to one open interface.

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
        self._port: BufferedPort | None = getattr(bus, "serialPortOrig", None)
        self._on_lost = on_lost
        self._loop = asyncio.get_running_loop()
        self._closed = False
        self._why = _CLOSED
        self.lock = threading.Lock()
        """Held while the interface sends; take it to close that."""
        self._unsent: deque[_Waiting] = deque()
        self._full_since = 0.0
        self._again: asyncio.TimerHandle | None = None
        self._queue: queue.SimpleQueue[_Waiting | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        if not prompt:
            self._thread = threading.Thread(target=self._transmit, daemon=True, name=f"{name} out")
            self._thread.start()

    def send(self, messages: Sequence[can.Message], until: float = math.inf) -> None:
        """Send frames, from the event loop; does not wait for the device.

        Parameters
        ----------
        messages
            In order.
        until
            Monotonic time in s after which those that still wait are dropped.

        Raises
        ------
        LinkDownError
            When the interface does not take a frame, ever.
        LinkError
            When too many frames wait already.
        """
        if self._unsent or not self._prompt:
            self._enqueue([_Waiting(message, until) for message in messages])
            return
        for i, message in enumerate(messages):
            if not self._try(message):
                self._wait_for_room([_Waiting(left, until) for left in messages[i:]])
                return

    async def send_in_time(self, message: can.Message, until: float) -> None:
        """Send a frame and see it leave, as far as the interface tells; not after `until`.

        Raises
        ------
        TooLateError
            When it was too late before the driver took it; it was not sent.
        LinkDownError
            When the interface does not take it, or does not let it out.
        LinkError
            When too many frames wait already.
        """
        if time.monotonic() > until:
            raise _too_late()
        if self._prompt and not self._unsent and self._try(message):
            await self._leaves(until)
            return
        waiting = _Waiting(message, until, self._loop.create_future())
        if self._unsent or not self._prompt:
            self._enqueue([waiting])
        else:
            self._wait_for_room([waiting])
        assert waiting.sent is not None  # noqa: S101
        await waiting.sent
        await self._leaves(until)

    async def _leaves(self, until: float) -> None:
        """See that a serial adapter's port lets out what it took."""
        if self._port is None:
            return
        last = min(until, time.monotonic() + _PATIENCE)
        while not self._closed and self._port.unsent:
            if time.monotonic() > last:
                self._port.discard()
                why = "cannot send: the adapter takes no more characters (they were withdrawn)"
                self._lose(why)
                raise LinkDownError(why)
            await asyncio.sleep(_AGAIN)

    def _enqueue(self, waiting: Sequence[_Waiting]) -> None:
        others = len(self._unsent) + self._queue.qsize()
        if others + len(waiting) > _MOST_UNSENT:
            raise LinkError(f"{others} frames wait to be sent")
        if self._prompt:
            self._unsent.extend(waiting)
        else:
            for one in waiting:
                self._queue.put(one)

    def _wait_for_room(self, waiting: Sequence[_Waiting]) -> None:
        self._unsent.extend(waiting)
        self._full_since = time.monotonic()
        self._again = self._loop.call_later(_AGAIN, self._retry)

    def send_and_wait(self, message: can.Message) -> None:
        """Send a frame from a thread that may wait for the device; raises python-can's errors."""
        deadline = time.monotonic() + _PATIENCE
        while True:
            if self._closed:
                raise LinkDownError(_CLOSED)
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
        left = [*self._unsent]
        self._unsent.clear()
        with contextlib.suppress(queue.Empty):
            while (one := self._queue.get_nowait()) is not None:
                left.append(one)
        for one in left:
            one.tell(LinkDownError(self._why))
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
                one = self._unsent[0]
                if not one.unwanted:
                    if time.monotonic() > one.until:
                        one.tell(_too_late())
                    elif not self._try(one.message):
                        break
                    else:
                        one.tell()
                        self._full_since = time.monotonic()
                self._unsent.popleft()
        if not self._unsent or self._closed:
            return
        if time.monotonic() - self._full_since > _PATIENCE:
            self._lose(f"cannot send: no room for a frame in {_PATIENCE:g} s")
            return
        self._again = self._loop.call_later(_AGAIN, self._retry)

    def _transmit(self) -> None:
        """Send what waits, in a thread: a driver may take its time."""
        while (one := self._queue.get()) is not None and not self._closed:
            if one.unwanted:
                continue
            left = one.until - time.monotonic()
            if left < 0.0:
                self._tell(one.tell, _too_late())
                continue
            try:
                with self.lock:
                    self._bus.send(one.message, timeout=min(_PATIENCE, left))
            except Exception as error:  # noqa: BLE001 - each interface raises its own
                why = f"cannot send: {error}"
                self._tell(one.tell, LinkDownError(why))
                self._tell(self._lose, why)
                return
            self._tell(one.tell)

    def _tell(self, function: Callable[..., None], *arguments: object) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(function, *arguments)

    def _lose(self, why: str) -> None:
        if not self._closed:
            self._why = why
            self._on_lost(why)


def _too_late() -> TooLateError:
    return TooLateError("too old before it could be sent, so not sent")


def _is_full(error: BaseException | None) -> bool:
    """Whether a frame was not taken only because others wait in the driver."""
    while error is not None:
        code = getattr(error, "error_code", None) or getattr(error, "errno", None)
        if code in _FULL or str(error) == "Transmit buffer full":  # python-can's socketcan
            return True
        error = error.__cause__
    return False
