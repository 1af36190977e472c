"""CAN error frames (Linux, ``linux/can/error.h``) and adapters' states, in words."""

from __future__ import annotations

import time
from collections.abc import Callable

from abbe.drivers.link import LinkDownError, LinkError

BUS_OFF = 0x40
LEFT_THE_BUS = "bus-off: the controller has left the bus"
_CLASSES = {
    0x01: "transmission timed out",
    0x02: "arbitration lost",
    0x04: "controller problem",
    0x08: "protocol violation",
    0x10: "transceiver problem",
    0x20: "nobody acknowledges (alone on the bus, or wrong bit rate?)",
    0x40: "bus-off",
    0x80: "bus error",
    0x100: "controller restarted",
}
_CONTROLLER = {
    0x01: "receive buffer overflow: frames were lost",
    0x02: "transmit buffer overflow",
    0x04: "receive errors reached the warning level",
    0x08: "transmit errors reached the warning level",
    0x10: "receive error passive",
    0x20: "transmit error passive",
    0x40: "error active again",
}


def is_bus_off(identifier: int) -> bool:
    """Whether the controller has left the bus."""
    return bool(identifier & BUS_OFF)


def is_recovery(identifier: int, data: bytes) -> bool:
    """Whether the frame says that all is well again."""
    active = identifier & 0x04 and len(data) > 1 and data[1] & 0x40
    return bool(identifier & 0x100 or active)


def error_text(identifier: int, data: bytes) -> str:
    """An error frame in words.

    >>> error_text(0x40, bytes(8))
    'bus-off'
    >>> error_text(0x04, bytes([0, 0x10, 0, 0, 0, 0, 0, 0]))
    'receive error passive'
    """
    words = []
    for bit, text in _CLASSES.items():
        if not identifier & bit:
            continue
        details = []
        if bit == 0x04 and len(data) > 1:
            details = [more for flag, more in _CONTROLLER.items() if data[1] & flag]
        words += details or [text]
    return ", ".join(words) or f"error frame {identifier:#x}"


class BusErrors:
    """The trouble that a bus reports; forgotten when it says so, or nothing more comes.

    Parameters
    ----------
    on_bus_off
        Called with the reason when the controller has left the bus.
    on_change
        Called when `text` changed.
    linux
        Whether the interface's error frames are Linux's; what others put into theirs is not
        interpreted.

    Attributes
    ----------
    count
        Error frames so far.
    """

    LINGER = 5.0
    """s for which an error frame matters."""

    def __init__(
        self, on_bus_off: Callable[[str], None], on_change: Callable[[], None], *, linux: bool
    ) -> None:
        self._linux = linux
        self._on_bus_off = on_bus_off
        self._on_change = on_change
        self._last = 0.0
        self._framed = ""
        self._state = ""
        self._left = ""
        self.count = 0

    @property
    def text(self) -> str:
        """What is wrong now, for people; empty when nothing is."""
        return "; ".join(filter(None, (self._framed, self._state)))

    def renew(self) -> None:
        """The interface is opened anew: nothing is known."""
        self._framed = self._state = self._left = ""

    def take(self, identifier: int, data: bytes) -> None:
        """An error frame came."""
        self.count += 1
        self._last = time.monotonic()
        if not self._linux:
            text = "the interface reports error frames"
        elif is_bus_off(identifier):
            self._leave(error_text(identifier, data))
            return
        else:
            text = "" if is_recovery(identifier, data) else error_text(identifier, data)
        if text != self._framed:
            self._framed = text
            self._on_change()

    def state(self, text: str, bus_off: bool) -> None:
        """An adapter reported its controller's state, which holds until it reports another one."""
        if bus_off:
            self._leave(text)
        elif text != self._state:
            self._state = text
            self._on_change()

    def explained(self, error: LinkError) -> LinkError:
        """Why nothing was heard since `renew`, if the bus itself said why."""
        if self._left:
            return LinkDownError(self._left)
        return type(error)(f"{error}; {self.text}") if self.text else error

    def forget_old(self) -> None:
        """Call now and then."""
        if self._framed and time.monotonic() - self._last > self.LINGER:
            self._framed = ""
            self._on_change()

    def _leave(self, why: str) -> None:
        self._framed = self._state = ""
        self._left = f"{LEFT_THE_BUS} ({why})"
        self._on_bus_off(self._left)
