"""A CANopen node: start-up, NMT states, heartbeat, emergencies, SDO, PDOs (CiA 301)."""

from __future__ import annotations

import asyncio
import struct
import time
from collections import deque

from abbe.drivers.simulated.can.sdo_server import READ_ONLY, AbortCodeError, Entry, Key, SdoServer
from abbe.drivers.simulated.can.wire import CanFrame, CanWire

INITIALISING, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0, 4, 5, 127
_NMT = {1: OPERATIONAL, 2: STOPPED, 128: PRE_OPERATIONAL}
_RESETS = (129, 130)


class CanopenNode:
    """One node.

    Parameters
    ----------
    wire
        Its bus.
    number
        Node id, 1 to 127.
    device_type
        Object 1000h.
    objects
        The device's own objects, in addition to the communication profile's.
    mapped
        Objects (index, subindex, bits) that both PDOs carry: TPDO1 cyclically (event timer), TPDO2
        at each SYNC.
    event_every
        s between two TPDO1; 0 none.

    Attributes
    ----------
    silent, deaf
        Sends nothing; hears nothing.
    late
        s by which SDO answers come later.
    heart_stopped
        Sends no heartbeat.
    heartbeat_fixed
        Refuses to have its heartbeat set.
    transmission
        TPDO2's transmission type: sent at every so many SYNC.
    """

    def __init__(
        self,
        wire: CanWire,
        number: int,
        device_type: int,
        objects: dict[Key, Entry],
        mapped: tuple[tuple[int, int, int], ...] = (),
        event_every: float = 0.0,
    ) -> None:
        self._wire_speak = wire.join(self._hear)
        self.number = number
        self.state = INITIALISING
        self.silent = self.deaf = self.heart_stopped = False
        self.heartbeat_fixed = False
        self.transmission = 1
        self._syncs = 0
        self.late = 0.0
        self.heartbeat_every = 0.0
        self._event_every = event_every
        self._error = (0, 0)
        self._mapped = mapped
        self.objects = dict(objects)
        self._add_communication(device_type)
        self.sdo = SdoServer(self.objects)
        self._free_at = 0.0
        self._owed: deque[CanFrame] = deque()

    def _add_communication(self, device_type: int) -> None:
        def u32(value: int) -> Entry:
            return Entry(lambda: struct.pack("<L", value))

        def u8(value: int) -> Entry:
            return Entry(lambda: bytes((value,)))

        def take_heartbeat(data: bytes) -> None:
            if self.heartbeat_fixed:
                raise AbortCodeError(READ_ONLY)
            self.heartbeat_every = int.from_bytes(data, "little") * 1e-3

        objects, number = self.objects, self.number
        objects[0x1000, 0] = u32(device_type)
        objects[0x1001, 0] = Entry(lambda: bytes((self._error[1],)))
        objects[0x1017, 0] = Entry(
            lambda: struct.pack("<H", round(self.heartbeat_every * 1e3)), take_heartbeat
        )
        objects[0x1018, 0] = u8(1)
        objects[0x1018, 1] = u32(0x2A)
        if not self._mapped:
            return
        kinds = (u8(254), Entry(lambda: bytes((self.transmission,))))
        for pdo, (cob, kind) in enumerate(zip((0x180, 0x280), kinds, strict=True)):
            objects[0x1800 + pdo, 0] = u8(2)
            objects[0x1800 + pdo, 1] = u32(cob + number)
            objects[0x1800 + pdo, 2] = kind
            objects[0x1A00 + pdo, 0] = u8(len(self._mapped))
            for i, (index, sub, bits) in enumerate(self._mapped):
                objects[0x1A00 + pdo, i + 1] = u32(index << 16 | sub << 8 | bits)

    def boot(self) -> None:
        """Switch on: boot-up message, then pre-operational; what was set by SDO is forgotten."""
        self.heartbeat_every = 0.0
        self._error = (0, 0)
        self.state = PRE_OPERATIONAL
        self.speak(CanFrame(0x700 + self.number, b"\0"))

    def emergency(self, code: int, register: int, more: bytes = b"") -> None:
        """Report an error; code 0: it is gone."""
        self._error = (code, register)
        data = struct.pack("<HB", code, register) + more.ljust(5, b"\0")
        self.speak(CanFrame(0x80 + self.number, data))

    def speak(self, frame: CanFrame) -> None:
        """Send a frame, unless switched off."""
        if not self.silent:
            self._wire_speak(frame)

    async def live(self) -> None:
        """Heartbeat and event timer, for ever."""
        beat_due = event_due = 0.0
        while True:
            await asyncio.sleep(0.005)
            now = time.monotonic()
            if self.heartbeat_every and now >= beat_due and not self.heart_stopped:
                beat_due = max(beat_due + self.heartbeat_every, now)
                self.speak(CanFrame(0x700 + self.number, bytes((self.state,))))
            if self._event_every and self.state == OPERATIONAL and now >= event_due:
                event_due = max(event_due + self._event_every, now)
                self._send_pdo(0x180)

    def _hear(self, frame: CanFrame) -> None:
        if self.deaf or self.silent or frame.extended or frame.error or frame.remote:
            return
        if frame.id == 0x600 + self.number and self.state != STOPPED:
            self._answer_sdo(frame.data)
        elif frame.id == 0x80 and self.state == OPERATIONAL and self._mapped:
            self._syncs += 1
            if self._syncs % self.transmission == 0:
                self._send_pdo(0x280)
        elif frame.id == 0 and len(frame.data) == 2 and frame.data[1] in (0, self.number):
            if frame.data[0] in _RESETS:
                self.boot()
            else:
                self.state = _NMT.get(frame.data[0], self.state)

    def _answer_sdo(self, request: bytes) -> None:
        for answer in self.sdo.answers(request):
            self.send_answer(answer, self.late)

    def send_answer(self, answer: bytes, late: float) -> None:
        """Send an SDO answer after some s, never before one that is owed from earlier."""
        loop = asyncio.get_running_loop()
        self._free_at = due = max(loop.time() + late, self._free_at)
        frame = CanFrame(0x580 + self.number, answer)
        if due > loop.time() or self._owed:
            # timers for one and the same moment ring in any order
            self._owed.append(frame)
            loop.call_at(due, lambda: self.speak(self._owed.popleft()))
        else:
            self.speak(frame)

    def _send_pdo(self, cob: int) -> None:
        data = b"".join(self.objects[index, sub].get() for index, sub, _ in self._mapped)
        self.speak(CanFrame(cob + self.number, data))
