"""Modbus as the specification has it (Application Protocol V1.1b3): questions in, answers out."""

from __future__ import annotations

import dataclasses
import math
import struct
import time
from collections.abc import Callable, Collection
from typing import NamedTuple

from abbe.drivers.simulated.torment.judge.evidence import AXES, ShownPicture
from abbe.drivers.simulated.torment.loop import Moment
from abbe.drivers.simulated.torment.machine import RESOLUTION, TormentMachine
from abbe.drivers.simulated.torment.script import Torment

SHOWN_AT = 0
"""Address of the first register that shows the machine."""
HELD_AT = 100
"""Address of the first register that is Abbe's, in the holding table."""
CODES = (1, 2, 3, 4, 6, 10, 11)
"""Exceptions that are given."""
_PLACES = {"status": 0, "heartbeat": 1, "number": 2, "X": 4, "Y": 6, "Z": 8, "T_x": 10}
_SIZE = 12


class ModbusReply(NamedTuple):
    """The reply to one question.

    Attributes
    ----------
    pdu
        The honest answer.
    shown
        The picture in it, if any.
    foreign
        An answer of the same shape with wrong positions.
    refusal
        The exception.
    """

    pdu: bytes
    shown: ShownPicture | None
    foreign: bytes
    refusal: bytes


def shown_registers(shown: ShownPicture) -> bytes:
    """All registers that show the machine: U16 U16 U32 3×S32 (0.01 µm) F32, high word first."""
    counts = (round(p / RESOLUTION) for p in shown.place)
    return struct.pack(
        ">HHIiiif",
        shown.status,
        shown.beat & 0xFFFF,
        shown.number & 0xFFFFFFFF,
        *counts,
        shown.temperature,
    )


def held_registers(held: dict[str, float]) -> bytes:
    """All registers that are Abbe's: U16 U16 3×S32 U32."""
    counts = (round(held.get(a, 0.0) / RESOLUTION) for a in AXES)
    return struct.pack(
        ">HHiiiI",
        int(held.get("status", 0)),
        int(held.get("heartbeat", 0)),
        *counts,
        int(held.get("echo", 0)),
    )


class ModbusDevice:
    """The machine as a Modbus device: answers one question at a time.

    Parameters
    ----------
    machine
        What is shown and what takes.
    table
        The table that shows the machine: 3 holding registers, 4 input registers.
    kinds
        What it can be tormented with.
    """

    def __init__(self, machine: TormentMachine, table: int, kinds: Collection[str]) -> None:
        self._machine = machine
        self._table = table
        self._kinds = frozenset(kinds)

    def active(self, kind: str, now: float) -> Torment | None:
        """The torment of this kind that goes on at a monotonic time, when it can have it."""
        return self._machine.script.active(kind, now) if kind in self._kinds else None

    def reply(self, pdu: bytes, moment: Moment) -> ModbusReply | None:
        """The answer to a question; None: no answer at all, it was lost or shall stay so."""
        now = time.monotonic()
        active = self.active
        torment = active("refused", now) or active("refused_long", now)
        code = CODES[int((torment.amount if torment else 0.4) * 6.99)]
        refusal = bytes((pdu[0] | 0x80, code))
        if pdu[0] in (3, 4) and len(pdu) == 5:
            address, count = struct.unpack(">HH", pdu[1:])
            if active("narrow", now) and count > 4:
                return self._refused(pdu, 2)
            return self._read(pdu[0], address, count, refusal)
        if pdu[0] == 16 and len(pdu) >= 6 and len(pdu) == 6 + pdu[5]:
            address = struct.unpack(">H", pdu[1:3])[0]
            return self._write(pdu[:5], address, pdu[6:], moment, refusal)
        if pdu[0] == 6 and len(pdu) == 5:
            address = struct.unpack(">H", pdu[1:3])[0]
            return self._write(pdu, address, pdu[3:], moment, refusal)
        return self._refused(pdu, 1)

    @staticmethod
    def _refused(pdu: bytes, code: int) -> ModbusReply:
        refusal = bytes((pdu[0] | 0x80, code))
        return ModbusReply(refusal, None, b"", refusal)

    def _read(self, table: int, address: int, count: int, refusal: bytes) -> ModbusReply:
        now = time.monotonic()
        held_end = HELD_AT + len(held_registers({})) // 2
        if table == 3 and address >= HELD_AT and address + count <= held_end:
            image = held_registers(self._machine.held)
            data = image[2 * (address - HELD_AT) :][: 2 * count]
            return ModbusReply(bytes((3, len(data))) + data, None, b"", refusal)
        if table != self._table or address < SHOWN_AT or address + count > SHOWN_AT + _SIZE:
            return self._refused(bytes((table,)), 2)
        shown = self._machine.look(now)
        make = _answer(table, address - SHOWN_AT, count)
        covers = frozenset(
            name
            for name, at in _PLACES.items()
            if address - SHOWN_AT <= at and at + _words(name) <= address - SHOWN_AT + count
        )
        stated = dataclasses.replace(shown, covers=covers)
        return ModbusReply(make(shown), stated, make(self._machine.poisoned(now)), refusal)

    def _write(
        self, head: bytes, address: int, data: bytes, moment: Moment, refusal: bytes
    ) -> ModbusReply | None:
        """The answer to a write; None: none comes, whether it was taken or not."""
        now = time.monotonic()
        active = self.active
        at = address - HELD_AT
        image = bytearray(held_registers(self._machine.held))
        if at < 0 or 2 * at + len(data) > len(image):
            return self._refused(head, 2)
        if active("refused", now) or active("refused_long", now):
            return ModbusReply(refusal, None, b"", refusal)
        if active("write_refused", now):
            return self._refused(head, 4)
        lost = active("write_unanswered", now)
        if not active("silent", now) and not (lost and lost.amount >= 0.5):
            image[2 * at : 2 * at + len(data)] = data
            self._machine.take(moment, _held(bytes(image), at, len(data) // 2))
        return None if lost else ModbusReply(head, None, b"", refusal)


def _words(name: str) -> int:
    return 1 if name in ("status", "heartbeat") else 2


def _answer(table: int, at: int, count: int) -> Callable[[ShownPicture], bytes]:
    def make(shown: ShownPicture) -> bytes:
        data = shown_registers(shown)[2 * at : 2 * (at + count)]
        return bytes((table, len(data))) + data

    return make


def _held(image: bytes, at: int, count: int) -> dict[str, float]:
    """The values of an image that a message of `count` registers from `at` on wrote."""
    status, beat, x, y, z, echo = struct.unpack(">HHiiiI", image)
    values = {
        "status": (0, 1, float(status)),
        "heartbeat": (1, 1, float(beat)),
        "X": (2, 2, x * RESOLUTION),
        "Y": (4, 2, y * RESOLUTION),
        "Z": (6, 2, z * RESOLUTION),
        "echo": (8, 2, float(echo)),
    }
    return {
        name: value
        for name, (place, words, value) in values.items()
        if place >= at and place + words <= at + count and not math.isnan(value)
    }


_SHOWN = """status = {{ table = "{table}", address = 0, type = "uint16" }}
beat = {{ table = "{table}", address = 1, type = "uint16" }}
number = {{ table = "{table}", address = 2, type = "uint32" }}
X = {{ table = "{table}", address = 4, type = "int32", scale = 1e-5, unit = "mm" }}
Y = {{ table = "{table}", address = 6, type = "int32", scale = 1e-5, unit = "mm" }}
Z = {{ table = "{table}", address = 8, type = "int32", scale = 1e-5, unit = "mm" }}
T_x = {{ table = "{table}", address = 10, type = "float32", unit = "degC" }}
"""
_OUT = (
    ("status", 0, 'type = "uint16"'),
    ("beat", 1, 'type = "uint16"'),
    ("X", 2, 'type = "int32", scale = 1e-5, unit = "mm"'),
    ("Y", 4, 'type = "int32", scale = 1e-5, unit = "mm"'),
    ("Z", 6, 'type = "int32", scale = 1e-5, unit = "mm"'),
    ("echo", 8, 'type = "uint32"'),
)


def shown_channels(variant: str) -> str:
    """The registers that show the machine, as the configuration has them."""
    return _SHOWN.format(table="holding" if variant == "holding" else "input")


def held_channels(variant: str) -> str:
    """Abbe's registers, as the configuration has them."""
    verify = ", verify = true" if variant == "verify" else ""
    return "".join(
        f'out_{name} = {{ table = "holding", address = {HELD_AT + at}, {how}, '
        f"writable = true{verify} }}\n"
        for name, at, how in _OUT
    )
