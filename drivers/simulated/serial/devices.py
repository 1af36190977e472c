"""Devices that speak ASCII over a serial line: a digital read-out, thermometer modules.

The read-out answers ``R`` with all axes (``X+00012.3456 Y-00003.2100 Z+00000.0000``) and ``X``,
``Y``, ``Z`` with one (``+00012.3456``), takes ``PX+12.5`` (preset) with ``OK``, and answers the
rest with ``?``. The thermometer modules sit on one line and are called by address: ``#02`` is
answered by ``>+0021.503+0022.104``.
"""

from __future__ import annotations

import functools
import math
import operator
import re
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol


class AsciiDevice(Protocol):
    """A simulated device that answers lines of ASCII."""

    def answer(self, query: str) -> str | None:
        """The answer to a line, without its end; None where there is none."""

    def spontaneous(self) -> str:
        """What it sends by itself when it streams."""


@dataclass
class ReadOut:
    """A three-axis digital read-out; its axes wander on circles so that old values show.

    Attributes
    ----------
    speed
        Turns per second of the wandering; 0 stands still.
    preset
        What was added to each axis, mm.
    """

    speed: float = 0.05
    preset: dict[str, float] = field(default_factory=lambda: dict.fromkeys("XYZ", 0.0))
    _began: float = field(default_factory=time.monotonic)

    def position(self, axis: str) -> float:
        """Where an axis is now, mm, to the read-out's 0.1 µm."""
        angle = 2.0 * math.pi * self.speed * (time.monotonic() - self._began)
        phase = {"X": 0.0, "Y": 2.0, "Z": 4.0}[axis]
        return round(100.0 * math.sin(angle + phase) + self.preset[axis], 4)

    def answer(self, query: str) -> str:
        """As `AsciiDevice.answer`."""
        if query == "R":
            return self.spontaneous()
        if query in self.preset:
            return f"{self.position(query):+011.4f}"
        stated = re.fullmatch(r"P([XYZ])([-+]?\d+\.?\d*)", query)
        if stated is None:
            return "?"
        axis, wanted = stated[1], float(stated[2])
        self.preset[axis] += wanted - self.position(axis)
        return "OK"

    def spontaneous(self) -> str:
        """All axes."""
        return " ".join(f"{axis}{self.position(axis):+011.4f}" for axis in "XYZ")


@dataclass
class ThermometerModules:
    """Modules with two sensors each on one line.

    Attributes
    ----------
    temperatures
        Address → °C of its sensors.
    dead
        Addresses that do not answer.
    """

    temperatures: dict[int, list[float]] = field(
        default_factory=lambda: {n: [20.0 + n, 20.5 + n] for n in (1, 2, 3)}
    )
    dead: set[int] = field(default_factory=set)

    def answer(self, query: str) -> str | None:
        """As `AsciiDevice.answer`: a module that is not called says nothing."""
        called = re.fullmatch(r"#(\d\d)", query)
        address = int(called[1]) if called else 0
        if address in self.dead or address not in self.temperatures:
            return None
        return ">" + "".join(f"{t:+09.3f}" for t in self.temperatures[address])

    def spontaneous(self) -> str:
        """All sensors."""
        return " ".join(f"{t:+09.3f}" for ts in self.temperatures.values() for t in ts)


def xor(data: bytes) -> bytes:
    """Two hexadecimal digits of the exclusive or of all bytes (as in NMEA 0183)."""
    return b"%02X" % functools.reduce(operator.xor, data, 0)


@dataclass
class LineFaults:
    """What is wrong with the line; counts go down by one for each answer.

    Attributes
    ----------
    silent_until
        No answers before this time (monotonic, s).
    late, lateness
        So many answers come so much (s) later.
    garbled
        So many answers have a wrong character.
    cut
        So many answers lack their end.
    echo
        The device's adapter hears what it is sent.
    """

    silent_until: float = 0.0
    late: int = 0
    lateness: float = 0.0
    garbled: int = 0
    cut: int = 0
    echo: bool = False


class LineServer:
    """Lines in, lines out, with checksums where wanted and with faults.

    Parameters
    ----------
    device
        What answers.
    send
        Sends bytes.
    later
        Calls a function after so many s.
    checksum
        Whether lines end in ``*`` and an exclusive or.
    """

    END = b"\r\n"

    def __init__(
        self,
        device: AsciiDevice,
        send: Callable[[bytes], None],
        later: Callable[[float, Callable[[], None]], object],
        *,
        checksum: bool = False,
    ) -> None:
        self.faults = LineFaults()
        self.queries = 0
        self._device = device
        self._send = send
        self._later = later
        self._checksum = checksum
        self._held = b""
        self._free_at = 0.0
        self._owed: deque[bytes] = deque()

    def receive(self, data: bytes) -> None:
        """Take bytes in and answer the queries that they complete."""
        if self.faults.echo:
            self._send(data)
        *lines, self._held = (self._held + data).split(self.END)
        for line in lines:
            self.queries += 1
            query = self._checked(line)
            text = None if query is None else self._device.answer(query)
            if text is not None:
                self._answer(self.framed(text))

    def stream(self) -> None:
        """Send by itself, once."""
        self._answer(self.framed(self._device.spontaneous()))

    def framed(self, text: str) -> bytes:
        """A line as it is sent."""
        line = text.encode("ascii")
        return line + (b"*" + xor(line) if self._checksum else b"") + self.END

    def _checked(self, line: bytes) -> str | None:
        if self._checksum:
            line, _, stated = line.rpartition(b"*")
            if stated != xor(line):
                return None
        return line.decode("latin-1")

    def _answer(self, data: bytes) -> None:
        faults, now = self.faults, time.monotonic()
        if now < faults.silent_until:
            return
        if faults.garbled > 0:
            faults.garbled -= 1
            data = data[:3] + b"~" + data[4:]
        if faults.cut > 0:
            faults.cut -= 1
            data = data[: -len(self.END) - 2]
        due = now
        if faults.late > 0:
            faults.late -= 1
            due = now + faults.lateness
        # A device answers in turn: never before what it owes from earlier.
        self._free_at = due = max(due, self._free_at)
        if due > now or self._owed:
            # timers for one and the same moment ring in any order
            self._owed.append(data)
            self._later(max(0.0, due - now), lambda: self._send(self._owed.popleft()))
        else:
            self._send(data)
