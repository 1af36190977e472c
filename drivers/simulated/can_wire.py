"""The wire of a simulated CAN bus: everybody hears everybody else.

Three kinds of ends: devices (callbacks in this process), a LAWICEL (slcan) adapter on a
pseudo-terminal, and python-can's ``udp_multicast``.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import NamedTuple

from .pty_port import PtyPort

EXTENDED = 0x20000000
"""Flag of an id that has 29 bits."""
_LARGEST_STANDARD = 0x7FF


class Frame(NamedTuple):
    """One CAN frame; an error frame is not on the wire, the adapter makes it up."""

    id: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False
    error: bool = False
    length: int = 0
    """Of a remote frame's answer."""


Hearer = Callable[[Frame], None]


class Wire:
    """A bus in this process.

    Attributes
    ----------
    broken
        Nothing comes through any more.
    """

    def __init__(self) -> None:
        self._ends: list[Hearer] = []
        self._speaking = 0
        self._began = 0.0
        self.broken = False

    @property
    def time(self) -> float:
        """The moment (monotonic, s): the same for all who hear one frame."""
        return self._began if self._speaking else time.monotonic()

    def join(self, hear: Hearer) -> Callable[[Frame], None]:
        """Add an end; hands back the function by which it speaks."""
        self._ends.append(hear)

        def speak(frame: Frame) -> None:
            if self.broken:
                return
            self._began = self.time
            self._speaking += 1
            try:
                for other in self._ends:
                    if other is not hear:
                        other(frame)
            finally:
                self._speaking -= 1

        return speak


class LawicelAdapter:
    """A serial-line CAN adapter (LAWICEL CAN232 manual, version 3; Linux: slcan).

    ``S6`` speed, ``O`` open, ``C`` close, ``tIIIL…`` and ``TIIIIIIIIL…`` data frames, ``r``, ``R``
    remote frames, ``V`` version, ``N`` serial number; carriage return ends a command and is the
    answer, BELL refuses one, ``z`` or ``Z`` in front of it confirms a frame.

    Parameters
    ----------
    wire
        The bus.
    make_port
        Makes its serial port, given what takes the bytes.
    """

    def __init__(self, wire: Wire, make_port: Callable[[Callable[[bytes], None]], PtyPort]) -> None:
        self._speak = wire.join(self._hear)
        self.port = make_port(self._receive)
        self._held = b""
        self.open = False
        self.deaf = False

    def reset(self) -> None:
        """What a dip in its supply does: it forgets that it was opened, and says nothing."""
        self.open = False
        self._held = b""

    def _hear(self, frame: Frame) -> None:
        if self.open and not frame.error:
            self.port.send(_text(frame))

    def _receive(self, data: bytes) -> None:
        *commands, self._held = (self._held + data).split(b"\r")
        for command in commands:
            self.port.send(self._carry_out(command.decode("latin-1")))

    def _carry_out(self, command: str) -> bytes:
        kind, rest = command[:1], command[1:]
        if kind in ("t", "T", "r", "R"):
            frame = _frame(kind, rest)
            if not self.open or frame is None:
                return b"\a"
            if not self.deaf:
                self._speak(frame)
            return b"z\r" if kind in ("t", "r") else b"Z\r"
        if kind == "O":
            self.open = True
        elif kind == "C":
            self.open = False
        elif kind == "V":
            return b"V1013\r"
        elif kind == "N":
            return b"NA123\r"
        elif kind not in ("S", "s", "L", "Z", "M", "m", ""):
            return b"\a"
        return b"\r"


def _text(frame: Frame) -> bytes:
    letter = ("R" if frame.extended else "r") if frame.remote else ("T" if frame.extended else "t")
    number = f"{frame.id:08X}" if frame.extended else f"{frame.id:03X}"
    length = frame.length if frame.remote else len(frame.data)
    return f"{letter}{number}{length:d}{frame.data.hex().upper()}\r".encode()


def _frame(kind: str, rest: str) -> Frame | None:
    extended = kind in ("T", "R")
    digits = 8 if extended else 3
    try:
        number, length = int(rest[:digits], 16), int(rest[digits])
        data = bytes.fromhex(rest[digits + 1 :])
    except (ValueError, IndexError):
        return None
    if kind in ("r", "R"):
        return Frame(number, b"", extended, True, False, length)
    return Frame(number, data, extended) if len(data) == length else None


class MulticastEnd:
    """The wire's way out over python-can's ``udp_multicast`` (needs the package msgpack).

    Parameters
    ----------
    wire
        The bus.
    group, port
        Multicast address and UDP port; nothing leaves this computer.
    """

    def __init__(self, wire: Wire, group: str, port: int) -> None:
        import can

        self._message = can.Message
        self._bus = can.Bus(
            interface="udp_multicast",
            channel=group,
            port=port,
            hop_limit=0,
            fd=False,
            ignore_config=True,
        )
        self._speak = wire.join(self._hear)
        asyncio.get_running_loop().add_reader(self._bus.fileno(), self._receive)

    def close(self) -> None:
        """Leave the group."""
        asyncio.get_running_loop().remove_reader(self._bus.fileno())
        self._bus.shutdown()

    def _hear(self, frame: Frame) -> None:
        self._bus.send(
            self._message(
                arbitration_id=frame.id,
                data=frame.data,
                is_extended_id=frame.extended,
                is_remote_frame=frame.remote,
                is_error_frame=frame.error,
                dlc=frame.length if frame.remote else len(frame.data),
            )
        )

    def _receive(self) -> None:
        message = self._bus.recv(0)
        if message is not None:
            self._speak(
                Frame(
                    message.arbitration_id,
                    bytes(message.data),
                    message.is_extended_id,
                    message.is_remote_frame,
                    message.is_error_frame,
                    message.dlc,
                )
            )
