"""Reception from a CAN interface, without blocking the event loop.

python-can's own asyncio `Notifier` calls ``recv`` from the event loop and catches nothing: when the
interface goes down, the exception ends in the loop's log and no frame comes any more, while
everything looks as before (python-can issues 1865, 1912; 4.6.1). Here any error while receiving
ends the connection and is reported; that an adapter falls silent without an error (its supply dips,
it forgets that it was opened) is noticed by the links, which know what should come.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import select
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from abbe.drivers.can.slcan_port import BufferedPort
from abbe.drivers.reply_wait import is_there

if TYPE_CHECKING:
    import can

    from abbe.drivers.can.datagrams import Datagrams

_MOST_AT_ONCE = 256
"""Frames that are taken before others get their turn in the event loop: all that fit into a serial
driver's 4 KB."""
_LOOK_EVERY = 0.1
"""s between two looks at whether something waits, and at both clocks, where frames are stamped."""
_STALLED = 0.05
"""s that a thread may take to fetch a frame before it counts as stalled."""
_DRIFT = 1e-3
"""Part of the time, and s besides, by which two clocks may differ before one counts as set."""
_LISTEN = 0.01
"""s between two looks at whether something waits to be read, where nobody stamps it: by so much a
frame may be younger than it is stated to be."""
_TOGETHER = 50e-6
"""s between two readings of a clock that count as one moment."""
_READINGS = 4
"""Of both clocks at most: who is stalled between the two takes an answer for older than its
question."""


class Incoming:
    """Reception from one open interface.

    Parameters
    ----------
    bus
        python-can's, or what receives in its place.
    stamped
        Whether the kernel says when a frame came (CLOCK_REALTIME): after we were stalled, what
        waited for us is not new.
    name
        For the thread of an interface without a file descriptor.
    since
        Monotonic time in s before which nothing came.
    on_frame
        Called in the event loop with every frame, the earliest and the latest moment at which it
        can have arrived (monotonic, s). The earliest is the kernel's stamp; without one, the last
        moment at which nothing waited to be read.
    on_lost
        Called in the event loop, with the reason, when receiving fails.
    """

    def __init__(
        self,
        bus: can.BusABC | Datagrams,
        *,
        stamped: bool,
        name: str,
        since: float = -math.inf,
        on_frame: Callable[[can.Message, float, float], None],
        on_lost: Callable[[str], None],
    ) -> None:
        self._bus = bus
        self._stamped = stamped
        self._since = since
        self._ahead = _difference()
        """By how much (s) CLOCK_REALTIME was ahead of the monotonic clock."""
        self._listening: asyncio.TimerHandle | None = None
        self._on_frame = on_frame
        self._on_lost = on_lost
        self._loop = asyncio.get_running_loop()
        self._closed = False
        self._thread: threading.Thread | None = None
        port = getattr(bus, "serialPortOrig", None)
        self._port = port if isinstance(port, BufferedPort) else None
        self._more = select.poll()
        try:
            self._fd = bus.fileno()
        except NotImplementedError:
            self._fd = -1
        if self._fd >= 0:
            self._more.register(self._fd, select.POLLIN)
            self._loop.add_reader(self._fd, self._readable)
            if not stamped:
                self._listen()
        else:
            self._thread = threading.Thread(target=self._receive, daemon=True, name=f"{name} in")
            self._thread.start()

    def close(self) -> None:
        """Take nothing more; from the event loop, before the interface is closed."""
        if self._closed:
            return
        self._closed = True
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
        if self._listening is not None:
            self._listening.cancel()

    def drain(self) -> None:
        """Take in what is there, where no stamp tells that it is no answer to the next question."""
        if self._closed or self._fd < 0:
            return
        if not self._stamped or time.monotonic() - self._since > _LOOK_EVERY:
            self._look()

    def join(self, limit: float) -> None:
        """Wait for the thread, at most so long (s)."""
        if self._thread is not None:
            self._thread.join(limit)

    def wait(self, seconds: float) -> bool:
        """Wait on the spot for frames, at most so long (s), and take them in; False when none came.

        Also False where there is no file descriptor: what comes, comes by the event loop.
        """
        if self._closed or self._fd < 0:
            return False
        if not self._stamped:
            if not is_there(self._fd, seconds):
                return False
            self._readable()
            return True
        # python-can waits for these by itself
        if (message := self._next(seconds)) is None:
            return False
        self._on_frame(message, *self._arrival(message))
        return True

    def _next(self, seconds: float) -> can.Message | None:
        """The next frame; None when there is none, or receiving failed, which is reported."""
        try:
            return self._bus.recv(seconds)
        except Exception as error:  # noqa: BLE001 - each interface raises its own
            self._on_lost(f"receiving failed: {error}")
            return None

    def _readable(self) -> None:
        """Take all frames that are there."""
        for _ in range(_MOST_AT_ONCE):
            if self._closed:
                return
            message = self._next(0.0)
            if message is not None:
                self._on_frame(message, *self._arrival(message))
            # asking the kernel costs a tenth of asking python-can in vain
            if self._closed or not self._more_waits():
                return
        if self._holds():
            self._loop.call_soon(self._readable)

    def _more_waits(self) -> bool:
        """Whether a frame waits; if none does, what comes from now on is no older."""
        looked = time.monotonic()
        if self._holds() or self._more.poll(0):
            return True
        if self._port is None or not self._port.has_begun:
            self._since = looked
        if self._stamped:
            self._ahead = _difference()
        return False

    def _look(self) -> None:
        if self._more_waits():
            self._readable()

    def _listen(self) -> None:
        self._look()
        if not self._closed:
            self._listening = self._loop.call_later(_LISTEN, self._listen)

    def _holds(self) -> bool:
        """Whether something has come that the file descriptor does not show."""
        return self._port is not None and self._port.holds

    def _arrival(self, message: can.Message) -> tuple[float, float]:
        if not self._stamped:
            return self._since, time.monotonic()
        now, clock = _clocks()
        # a clock that was set meanwhile says too much or too little; that nothing waited is certain
        if abs(clock - now - self._ahead) > _DRIFT * (1.0 + now - self._since):
            return self._since, self._since
        arrived = max(now - max(clock - message.timestamp, 0.0), self._since)
        return arrived, arrived

    def _receive(self) -> None:
        """As `_readable`, in a thread, for interfaces without a file descriptor."""
        since = self._since
        while not self._closed:
            looked = time.monotonic()
            try:
                message = self._bus.recv(0.0)
                if message is None:
                    since = looked
                    message = self._bus.recv(_LISTEN)
            except Exception as error:  # noqa: BLE001 - as above
                self._tell(self._on_lost, f"receiving failed: {error}")
                return
            if message is not None:
                here = time.monotonic()
                # whoever was stalled cannot tell what waited from what just came
                self._tell(
                    self._deliver, message, since, here if here - since < _STALLED else since
                )

    def _deliver(self, message: can.Message, earliest: float, latest: float) -> None:
        if not self._closed:
            self._on_frame(message, earliest, latest)

    def _tell(self, function: Callable[..., None], *arguments: object) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(function, *arguments)


def _clocks() -> tuple[float, float]:
    """The monotonic clock and CLOCK_REALTIME (s) at one moment, as far as nobody stalls us."""
    now = time.monotonic()
    for _ in range(_READINGS):
        before, clock = now, time.time()
        now = time.monotonic()
        if now - before < _TOGETHER:
            break
    return now, clock


def _difference() -> float:
    """By how much (s) CLOCK_REALTIME is ahead of the monotonic clock."""
    now, clock = _clocks()
    return clock - now
