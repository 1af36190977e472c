"""The status of a serial-line CAN adapter: bus-off, error passive, lost frames.

python-can's ``slcan`` knows of no such thing. Two ways are in use:

- Status flags, asked for by ``F``, answered by ``F`` and two hexadecimal digits (LAWICEL CAN232
  manual, version 3, "F[CR]"). Bit 7 is a bus error with LAWICEL's adapters and bus-off with the
  USBtin, whose firmware takes it from the MCP2515's TXBO; so the configuration says which it is.
- Lines that come by themselves when the state changes, as Linux' own slcan driver has them since
  6.0: ``s``, one of ``a w p b`` (active, warning, passive, bus-off), and three decimal digits each
  for the receive and the transmit error counter.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, NamedTuple

if TYPE_CHECKING:
    from abbe.drivers.can.slcan_port import BufferedPort

Dialect = Literal["lawicel", "usbtin"]
"""Whose meaning the status flags have."""

_ASK_EVERY = 0.1
"""s between two questions for the flags."""
_ASK_AGAIN = 0.5
"""s after which a question that was not answered is put again."""
_HUNG = 2.0
"""s without any answer after which the adapter counts as hung."""
_FLAGS = {
    0x01: "its receive queue was full: frames were lost",
    0x02: "its transmit queue is full",
    0x04: "errors reached the warning level",
    0x08: "data overrun: frames were lost",
    0x20: "error passive",
}
_BUS_ERROR = 0x80
_STATES = {"a": "", "w": "errors reached the warning level", "p": "error passive"}


class AdapterState(NamedTuple):
    """The state that an adapter reports of its CAN controller.

    Attributes
    ----------
    text
        What is wrong, for people; empty when nothing is.
    bus_off
        Whether it has left the bus.
    """

    text: str
    bus_off: bool


def understand(line: bytes, dialect: Dialect | None) -> AdapterState | None:
    """What a line that fits `LINE` says; None for flags of which nobody said whose they are.

    >>> understand(b"F24", "usbtin")
    AdapterState(text='the adapter says: error passive', bus_off=False)
    >>> understand(b"sb000256", None)
    AdapterState(text='the adapter says: bus-off, 0 receive and 256 transmit errors', bus_off=True)
    """
    if line[:1] == b"s":
        state, receive, transmit = line[1:2].decode(), int(line[2:5]), int(line[5:8])
        if state == "a":
            return AdapterState("", bus_off=False)
        words = _STATES.get(state, "bus-off")
        text = f"the adapter says: {words}, {receive} receive and {transmit} transmit errors"
        return AdapterState(text, state == "b")
    if dialect is None:
        return None
    flags = int(line[1:3], 16)
    parts = [words for bit, words in _FLAGS.items() if flags & bit]
    if flags & 0x20 and flags & 0x04:
        parts.remove(_FLAGS[0x04])
    bus_off = bool(flags & _BUS_ERROR) and dialect == "usbtin"
    if bus_off:
        parts = [f"bus-off, status flags {flags:02X}h"]
    elif flags & _BUS_ERROR:
        parts.append("errors on the bus")
    return AdapterState(f"the adapter says: {', '.join(parts)}" if parts else "", bus_off)


class AdapterStatus:
    """Listens to, and asks, one open adapter.

    Parameters
    ----------
    port
        Its port.
    lock
        Held while something is sent.
    dialect
        Whose status flags it has; None: it is not asked.
    on_state
        Called in the event loop with what the controller's state is, each time that it is reported.
    on_lost
        Called in the event loop, with the reason, when the adapter does not answer.
    """

    def __init__(
        self,
        port: BufferedPort,
        lock: threading.Lock,
        dialect: Dialect | None,
        on_state: Callable[[str, bool], None],
        on_lost: Callable[[str], None],
    ) -> None:
        self._port = port
        self._lock = lock
        self._dialect: Dialect | None = dialect
        self._on_state = on_state
        self._on_lost = on_lost
        self._closed = False
        self._waiting = False
        self._asked_at = 0.0
        self._answered_at = time.monotonic()
        self._timer: asyncio.TimerHandle | None = None
        port.on_status = self._take
        port.on_refused = self._refused
        if dialect is not None:
            self._ask_later()

    def close(self) -> None:
        """Ask no more, say no more; safe to call twice."""
        self._closed = True
        if self._timer is not None:
            self._timer.cancel()

    def _take(self, line: bytes) -> None:
        if line[:1] == b"F":
            self._waiting = False
            self._answered_at = time.monotonic()
        message = understand(line, self._dialect)
        if message is not None and not self._closed:
            self._on_state(*message)

    def _refused(self) -> None:
        """The adapter refused something, perhaps a frame: its flags say why."""
        if self._dialect is not None and not self._closed and not self._waiting:
            self._ask(time.monotonic())

    def _ask_later(self) -> None:
        due = time.monotonic() + _ASK_EVERY
        self._timer = asyncio.get_running_loop().call_later(_ASK_EVERY, self._look, due)

    def _look(self, due: float) -> None:
        now = time.monotonic()
        self._ask_later()
        if now - due > _ASK_EVERY:
            return  # it was us who were stalled: what has come is to be taken in first
        if now - self._answered_at > _HUNG:
            self._on_lost(
                f"the adapter has not reported its status flags for {_HUNG:g} s (hung, or it has "
                "none: leave out adapter_status)"
            )
        elif not self._waiting or now - self._asked_at > _ASK_AGAIN:
            self._ask(now)

    def _ask(self, now: float) -> None:
        # no room, or gone: both show elsewhere
        with self._lock, contextlib.suppress(OSError):
            self._port.write(b"F\r")
            self._waiting, self._asked_at = True, now
