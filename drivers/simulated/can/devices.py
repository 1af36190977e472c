"""Devices on a simulated CAN bus: encoders, a thermometer, a controller, frames of a DBC file.

Nodes 3, 4, 5 are absolute encoders (CiA 406) of X, Y, Z; node 6 has four temperature inputs (CiA
404); node 16 is a controller that takes a compensation table (object 2100h) and shows its length
and checksum. Besides, ``machine.dbc`` (in this folder) describes frames that are sent cyclically or
on demand.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable

from abbe.drivers.simulated.can.canopen_node import CanopenNode
from abbe.drivers.simulated.can.sdo_server import WRONG_LENGTH, AbortCodeError, Entry, Key
from abbe.drivers.simulated.can.wire import CanFrame, CanWire

ENCODERS = {3: "X", 4: "Y", 5: "Z"}
THERMOMETER, CONTROLLER = 6, 16
SPEED = 100_000
"""Counts per second at which every encoder moves; they stand 1, 2 and 3 million apart."""
_POSITION, _TEMPERATURES, _ON_DEMAND, _SETPOINT = 0x201, 0x202, 0x203, 0x204
_DIAGNOSIS = 0x18FF0012


def counts(axis: str, now: float) -> int:
    """An encoder's count at a time (monotonic, s)."""
    return 1_000_000 * ("XYZ".index(axis) + 1) + int(now * SPEED) % 500_000


def encoder(wire: CanWire, number: int, event_every: float) -> CanopenNode:
    """An absolute encoder, CiA 406: position value 6004h, in TPDO1 and TPDO2."""
    axis = ENCODERS[number]
    objects: dict[Key, Entry] = {
        (0x6004, 0): Entry(lambda: struct.pack("<L", counts(axis, wire.time))),
        (0x6500, 0): Entry(lambda: struct.pack("<H", 0)),
        (0x6503, 0): Entry(lambda: struct.pack("<H", 0)),
    }
    mapped = ((0x6004, 0, 32),)
    return CanopenNode(wire, number, 0x00020196, objects, mapped, event_every)


def thermometer(wire: CanWire, temperatures: list[float], event_every: float) -> CanopenNode:
    """Temperature inputs, CiA 404: hundredths of a degree in 7130h and 9130h, degrees in 6130h.

    The 16-bit values are in TPDO1 and TPDO2.
    """
    objects: dict[Key, Entry] = {}
    for index in (0x6130, 0x6131, 0x6132, 0x7130, 0x9130):
        objects[index, 0] = Entry(lambda: bytes((len(temperatures),)))
    for n in range(1, len(temperatures) + 1):

        def hundredths(n: int = n) -> int:
            return round(100.0 * temperatures[n - 1])

        objects[0x6130, n] = Entry(lambda n=n: struct.pack("<f", temperatures[n - 1]))  # type: ignore[misc]
        objects[0x6131, n] = Entry(lambda: struct.pack("<L", 0x002D0000))
        objects[0x6132, n] = Entry(lambda: b"\x02")
        objects[0x7130, n] = Entry(lambda get=hundredths: struct.pack("<h", get()))  # type: ignore[misc]
        objects[0x9130, n] = Entry(lambda get=hundredths: struct.pack("<l", get()))  # type: ignore[misc]
    mapped = tuple((0x7130, n, 16) for n in range(1, len(temperatures) + 1))
    return CanopenNode(wire, THERMOMETER, 0x00020194, objects, mapped, event_every)


class CanopenController:
    """A controller that holds a compensation table and switches it on.

    Attributes
    ----------
    table
        What was written last to 2100h, whole.
    active
        Checksum (CRC-32) that was written to 2103h; it must be the table's.
    """

    def __init__(self, wire: CanWire) -> None:
        self.table = b""
        self.active = 0
        self.offset = 0

        def take(data: bytes) -> None:
            if len(data) % 4:
                raise AbortCodeError(WRONG_LENGTH)
            self.table = data

        def activate(data: bytes) -> None:
            stated = int.from_bytes(data, "little")
            if stated != zlib.crc32(self.table):
                raise AbortCodeError(0x06090030)
            self.active = stated

        def take_offset(data: bytes) -> None:
            (self.offset,) = struct.unpack("<l", data)

        self.node = CanopenNode(
            wire,
            CONTROLLER,
            0,
            {
                (0x2100, 0): Entry(lambda: self.table, take),
                (0x2101, 0): Entry(lambda: struct.pack("<L", len(self.table))),
                (0x2102, 0): Entry(lambda: struct.pack("<L", zlib.crc32(self.table))),
                (0x2103, 0): Entry(lambda: struct.pack("<L", self.active), activate),
                (0x2200, 1): Entry(lambda: struct.pack("<l", self.offset), take_offset),
            },
        )


class FrameSender:
    """The device behind ``machine.dbc``: some frames cyclically, one on demand.

    Attributes
    ----------
    muted
        Sends nothing.
    only_page
        The only page of DIAGNOSIS that it sends; None: all.
    setpoints
        Data of the CORRECTION frames that came.
    """

    def __init__(self, wire: CanWire) -> None:
        self._wire = wire
        self.speak: Callable[[CanFrame], None] = wire.join(self._hear)
        self.muted = False
        self.only_page: int | None = None
        self.setpoints: list[bytes] = []
        self._cycles = 0

    def send(self) -> None:
        """One cycle's frames."""
        if self.muted:
            return
        now = self._wire.time
        x, y = counts("X", now), counts("Y", now)
        self.speak(CanFrame(_POSITION, struct.pack("<ll", x, y)))
        self.speak(CanFrame(_TEMPERATURES, struct.pack(">hhH", 2150, -325, 0)))
        page = self._cycles % 2 if self.only_page is None else self.only_page
        self._cycles += 1
        content = struct.pack("<BL", 1, 12345) if page else struct.pack("<BH", 0, 2410)
        self.speak(CanFrame(_DIAGNOSIS, content.ljust(8, b"\0"), extended=True))

    def _hear(self, frame: CanFrame) -> None:
        if frame.id == _ON_DEMAND and frame.remote and not self.muted:
            self.speak(CanFrame(_ON_DEMAND, struct.pack("<l", counts("Z", self._wire.time))))
        elif frame.id == _SETPOINT:
            self.setpoints.append(frame.data)
