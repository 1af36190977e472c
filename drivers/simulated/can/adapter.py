"""A simulated serial-line CAN adapter (LAWICEL's protocol, slcan) whose controller can fail."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from abbe.drivers.simulated.can.fault_confinement import FaultConfinement
from abbe.drivers.simulated.can.wire import CanFrame, CanWire
from abbe.drivers.simulated.pseudo_terminals.pty_port import PtyPort

Reports = Literal["nothing", "flags", "lines"]
"""How an adapter tells its controller's state: not at all, when asked, by itself."""
_BUFFERS = 3
"""Frames that wait to be transmitted; more are refused."""
_FLAGS = {"active": 0x00, "warning": 0x04, "passive": 0x24, "off": 0xA4}
"""Status flags by state, as the USBtin's firmware has them."""
_LETTERS = {"active": "a", "warning": "w", "passive": "p", "off": "b"}


class LawicelAdapter:
    """A serial-line CAN adapter (LAWICEL CAN232 manual, version 3; Linux: slcan).

    ``S6`` speed, ``O`` open, ``C`` close, ``tIIIL…`` and ``TIIIIIIIIL…`` data frames, ``r``, ``R``
    remote frames, ``V`` version, ``N`` serial number, ``F`` status flags; carriage return ends a
    command and is the answer, BELL refuses one, ``z`` or ``Z`` in front of it confirms a frame.
    A controller that is bus-off takes and hears nothing until it is closed and opened again.

    Parameters
    ----------
    wire
        The bus.
    make_port
        Makes its serial port, given what takes the bytes.
    reports
        How it tells its controller's state; ``lines`` as Linux' slcan driver expects them:
        ``s``, a letter, and both error counters.

    Attributes
    ----------
    deaf
        It confirms frames and sends none.
    hung
        It says nothing any more.
    openings
        How often it was opened.
    """

    def __init__(
        self,
        wire: CanWire,
        make_port: Callable[[Callable[[bytes], None]], PtyPort],
        reports: Reports = "nothing",
    ) -> None:
        self._wire = wire
        self._speak = wire.join(self._hear, self._spoilt, self._mended)
        self.port = make_port(self._receive)
        self._reports = reports
        self._reported = "active"
        self._held = b""
        self._unsent: list[CanFrame] = []
        self.faults = FaultConfinement()
        self.open = False
        self.deaf = False
        self.hung = False
        self.openings = 0

    def reset(self) -> None:
        """What a dip in its supply does: it forgets that it was opened, and says nothing."""
        self._close()
        self._held = b""

    # The bus's side

    def _hear(self, frame: CanFrame) -> None:
        if self.open and not frame.error and self.faults.state != "off":
            self.faults.received()
            self._say(_text(frame))
            self._tell_changes()

    def _spoilt(self) -> None:
        if self.open and self.faults.state != "off":
            self.faults.spoilt()
            self._tell_changes()

    def _mended(self) -> None:
        """The bus carries frames again: what is still to be repeated succeeds."""
        unsent, self._unsent = self._unsent, []
        for frame in unsent:
            self._transmit(frame)
        self._tell_changes()

    def _transmit(self, frame: CanFrame) -> None:
        """Put a frame on the bus; the controller repeats what fails by itself."""
        wire = self._wire
        if wire.shorted or wire.lonely:
            self.faults.fail(acknowledge=not wire.shorted)
            self._unsent.append(frame)
        else:
            self.faults.sent()
            self._speak(frame)
        if self.faults.state == "off":
            self._unsent.clear()

    # The computer's side

    def _say(self, data: bytes) -> None:
        if not self.hung:
            self.port.send(data)

    def _tell_changes(self) -> None:
        state, faults = self.faults.state, self.faults
        if self._reports == "lines" and state != self._reported:
            self._say(f"s{_LETTERS[state]}{faults.receive:03d}{faults.transmit:03d}\r".encode())
        self._reported = state

    def _close(self) -> None:
        self.open = False
        self._unsent.clear()
        self.faults.restart()
        self._reported = "active"

    def _receive(self, data: bytes) -> None:
        *commands, self._held = (self._held + data).split(b"\r")
        for command in commands:
            self._say(self._carry_out(command.decode("latin-1")))
            self._tell_changes()

    def _carry_out(self, command: str) -> bytes:
        kind, rest = command[:1], command[1:]
        if kind in ("t", "T", "r", "R"):
            return self._take(kind, rest)
        if kind == "F" and self.open and self._reports == "flags":
            return f"F{_FLAGS[self.faults.state]:02X}\r".encode()
        if kind == "O":
            self.open = True
            self.openings += 1
        elif kind == "C":
            self._close()
        elif kind == "V":
            return b"V1013\r"
        elif kind == "N":
            return b"NA123\r"
        elif kind not in ("S", "s", "L", "Z", "M", "m", ""):
            return b"\a"
        return b"\r"

    def _take(self, kind: str, rest: str) -> bytes:
        frame = _frame(kind, rest)
        if not self.open or frame is None:
            return b"\a"
        if self.faults.state == "off" or len(self._unsent) >= _BUFFERS:
            return b"\a"
        if not self.deaf:
            self._transmit(frame)
        return b"z\r" if kind in ("t", "r") else b"Z\r"


def _text(frame: CanFrame) -> bytes:
    letter = ("R" if frame.extended else "r") if frame.remote else ("T" if frame.extended else "t")
    number = f"{frame.id:08X}" if frame.extended else f"{frame.id:03X}"
    length = frame.length if frame.remote else len(frame.data)
    return f"{letter}{number}{length:d}{frame.data.hex().upper()}\r".encode()


def _frame(kind: str, rest: str) -> CanFrame | None:
    extended = kind in ("T", "R")
    digits = 8 if extended else 3
    try:
        number, length = int(rest[:digits], 16), int(rest[digits])
        data = bytes.fromhex(rest[digits + 1 :])
    except (ValueError, IndexError):
        return None
    if kind in ("r", "R"):
        return CanFrame(number, b"", extended, True, False, length)
    return CanFrame(number, data, extended) if len(data) == length else None
