"""Others on a CAN bus as the tests want them: they answer late, refuse for a while, go on talking.

Each is a thread of its own on python-can's bus, so that it goes on while the event loop stands
still.
"""

from __future__ import annotations

import contextlib
import struct
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import can

Answer = Callable[["Peer", can.Message], None]


class Peer:
    """Takes frames in and answers them.

    Attributes
    ----------
    came
        Ids of frames that came, each with the time at which it did (monotonic, s).
    """

    def __init__(self, bus: can.BusABC, answer: Answer) -> None:
        self.bus = bus
        self.came: list[tuple[float, int]] = []
        self._answer = answer
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def wait(self, seconds: float) -> None:
        """Take its time."""
        self._ended.wait(seconds)

    def send(self, can_id: int, data: bytes) -> None:
        """Send a frame with an 11-bit id."""
        self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def close(self) -> None:
        """Leave the bus."""
        self._ended.set()
        self._thread.join()
        self.bus.shutdown()

    def _serve(self) -> None:
        while not self._ended.is_set():
            if (frame := self.bus.recv(0.05)) is not None:
                self.came.append((time.monotonic(), frame.arbitration_id))
                self._answer(self, frame)


class Node:
    """A CANopen encoder: short SDO transfers, and its position in a PDO at every SYNC.

    Attributes
    ----------
    objects
        Its dictionary.
    late
        s that it waits, after it took its position, before it says what it is.
    refuses
        Objects that it refuses to read or write, by index.
    """

    def __init__(self, number: int) -> None:
        self.number = number
        self.late = 0.0
        self.refuses: set[int] = set()
        self.position = 0
        self.objects: dict[tuple[int, int], bytes] = {
            (0x1000, 0): struct.pack("<L", 406),
            (0x1800, 1): struct.pack("<L", 0x180 + number),
            (0x1800, 2): bytes([1]),
            (0x1A00, 0): bytes([1]),
            (0x1A00, 1): struct.pack("<L", 0x60040020),
            (0x2000, 0): bytes(4),
        }

    def answer(self, peer: Peer, frame: can.Message) -> None:
        """As `Peer` wants it."""
        if frame.arbitration_id == 0x80:
            data = struct.pack("<l", self.position)
            peer.wait(self.late)
            peer.send(0x180 + self.number, data)
        elif frame.arbitration_id == 0x600 + self.number:
            self._serve(peer, bytes(frame.data))

    def _serve(self, peer: Peer, data: bytes) -> None:
        command, index, subindex = struct.unpack_from("<BHB", data)
        head = struct.pack("<HB", index, subindex)
        held = self.objects | {(0x6004, 0): struct.pack("<l", self.position)}
        if index >= 0x6000:
            peer.wait(self.late)
        if command == 0x80:
            return
        if index in self.refuses or (index, subindex) not in held:
            answer = b"\x80" + head + struct.pack("<L", 0x08000021)
        elif command == 0x40:
            content = held[index, subindex]
            answer = bytes([0x43 | (4 - len(content)) << 2]) + head + content
        else:
            self.objects[index, subindex] = data[4 : 8 - (command >> 2 & 3)]
            answer = b"\x60" + head
        peer.send(0x580 + self.number, answer.ljust(8, b"\0"))


@contextlib.contextmanager
def peer(settings: dict[str, Any], answer: Answer = lambda *_: None) -> Iterator[Peer]:
    """Somebody on the bus of these settings."""
    bus = can.Bus(
        interface=settings["interface"],
        channel=settings["channel"],
        ignore_config=True,
        **settings.get("options", {}),
    )
    one = Peer(bus, answer)
    try:
        yield one
    finally:
        one.close()
