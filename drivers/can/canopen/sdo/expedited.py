"""Short SDO transfers on the event loop: several nodes asked at once, answered in one wait.

Objects of up to four bytes travel in one frame each way (CiA 301, 7.2.4.3). Positions and
temperatures are such objects, and a live cycle asks for them all the time: by the canopen package
that is one thread a node and four hand-overs an object, here one wait for all nodes together.
Whatever is longer is left to that package (`abbe.drivers.can.canopen.sdo.adapter`).
"""

from __future__ import annotations

import contextlib
import struct
import time
from collections.abc import Sequence
from dataclasses import dataclass

from abbe.drivers.can.bus import CanBus
from abbe.drivers.can.frames import frame
from abbe.drivers.reply_wait import ReplyWait

_HEAD = struct.Struct("<BHB")
_REQUEST, _RESPONSE = 0x600, 0x580
_UPLOAD, _DOWNLOAD = 0x40, 0x20
_EXPEDITED, _SIZED = 0x02, 0x01
_ABORTED = 0x80


@dataclass(slots=True, eq=False)
class Ask:
    """One object that is asked for, or written.

    Attributes
    ----------
    number
        The node's id.
    index, subindex
        The object.
    data
        To write; None reads.
    left
        When the request left (monotonic, s).
    answer
        What was read, or was written; None as long as there is none.
    aborted
        The abort code with which the node refused.
    too_long
        Whether the object is longer than four bytes: nothing was read.
    """

    number: int
    index: int
    subindex: int
    data: bytes | None = None
    left: float = 0.0
    answer: bytes | None = None
    aborted: int | None = None
    too_long: bool = False

    @property
    def done(self) -> bool:
        """Whether the node has answered."""
        return self.answer is not None or self.aborted is not None or self.too_long

    def request(self) -> bytes:
        """The frame that asks for it."""
        if self.data is None:
            return _HEAD.pack(_UPLOAD, self.index, self.subindex).ljust(8, b"\0")
        command = _DOWNLOAD | _EXPEDITED | _SIZED | (4 - len(self.data)) << 2
        return (_HEAD.pack(command, self.index, self.subindex) + self.data).ljust(8, b"\0")

    def take(self, data: bytes) -> bool:
        """Whether a frame answers it; takes the answer in."""
        if len(data) != 8:
            return False
        command, index, subindex = _HEAD.unpack_from(data)
        if (index, subindex) != (self.index, self.subindex):
            return False
        if command == _ABORTED:
            (self.aborted,) = struct.unpack_from("<L", data, 4)
        elif self.data is not None:
            if command & 0xE0 != 0x60:
                return False
            self.answer = self.data
        elif command & 0xE0 != _UPLOAD:
            return False
        elif command & _EXPEDITED:
            size = 4 - (command >> 2 & 3) if command & _SIZED else 4
            self.answer = data[4 : 4 + size]
        else:
            self.too_long = True
        return True


class Expedited:
    """Asks nodes on one bus.

    Parameters
    ----------
    bus
        Where frames go.
    """

    def __init__(self, bus: CanBus) -> None:
        self._bus = bus
        self._waiting: dict[int, Ask] = {}
        self._all_done: ReplyWait[None] = ReplyWait(bus.wait)

    async def ask(self, asked: Sequence[Ask], timeout: float) -> None:  # noqa: ASYNC109
        """Send all requests, then wait, at most `timeout` s, for all answers.

        Parameters
        ----------
        asked
            At most one for each node; their answers are in them afterwards.

        Raises
        ------
        LinkDownError
            When a frame cannot be sent, or the bus is closed meanwhile.
        """
        self._waiting = {_RESPONSE + one.number: one for one in asked}
        done = self._all_done
        done.begin(len(asked))
        began = time.monotonic()
        for one in asked:
            one.left = began
        try:
            self._bus.send(
                [frame(_REQUEST + one.number, one.request()) for one in asked], began + timeout
            )
            with contextlib.suppress(TimeoutError):
                await done.get(timeout)
        finally:
            done.end()
            self._waiting = {}
        for one in asked:
            if one.too_long:
                abort = _HEAD.pack(_ABORTED, one.index, one.subindex) + b"\0\0\0\x08"
                self._bus.send([frame(_REQUEST + one.number, abort)])

    def take(self, can_id: int, data: bytearray) -> bool:
        """Take in a frame; whether it was for us."""
        one = self._waiting.get(can_id)
        if one is None:
            return False
        if one.take(bytes(data)):
            del self._waiting[can_id]
            if not self._waiting:
                self._all_done.give(None)
        return True

    def fail(self, error: Exception) -> None:
        """End a wait with an error."""
        self._all_done.fail(error)
