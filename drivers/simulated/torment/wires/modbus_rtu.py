"""Modbus RTU on a raw pseudo-terminal: frames by their length, and the checksum."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import ClassVar

from abbe.drivers.simulated.torment.judge.evidence import WireLog
from abbe.drivers.simulated.torment.loop import Loop, Moment
from abbe.drivers.simulated.torment.machine import TormentMachine
from abbe.drivers.simulated.torment.wires.base import TormentWire
from abbe.drivers.simulated.torment.wires.modbus_pdu import (
    ModbusDevice,
    held_channels,
    shown_channels,
)
from abbe.drivers.simulated.torment.wires.modbus_tcp import MODBUS_KINDS
from abbe.drivers.simulated.torment.wires.pty import PtyEnd

UNIT = 1


class ModbusRtu(TormentWire):
    """Serves the machine's registers on a serial line."""

    KINDS: ClassVar[tuple[str, ...]] = MODBUS_KINDS
    VARIANTS: ClassVar[tuple[str, ...]] = ("plain", "patient")
    BLIND: ClassVar[float] = 0.05

    def __init__(
        self, loop: Loop, machine: TormentMachine, log: WireLog, folder: Path, variant: str
    ) -> None:
        super().__init__(loop, machine, log, folder, variant)
        self._device = ModbusDevice(machine, 4, self.KINDS)
        self._port = PtyEnd(loop, log, folder / "line", self._came)

    @property
    def links(self) -> str:
        """TOML of its links."""
        timeout = 1.0 if self.variant == "patient" else 0.1
        return (
            f'[links.m]\ndriver = "modbus"\ntransport = "rtu"\nport = "{self._port.path}"\n'
            f"baudrate = 115200\ntimeout = {timeout}\nreconnect_max = 0.3\nquarantine_max = 0.5\n"
            f"late_reply_max = 2.0\n[links.m.channels]\n"
            + shown_channels(self.variant)
            + held_channels(self.variant)
        )

    def open(self) -> None:
        """Begin to serve."""
        self._port.plug()

    def cut(self) -> None:
        """Unplug it."""
        self._port.unplug()

    def mend(self) -> None:
        """Plug it in again."""
        self._port.plug()

    def flood(self) -> None:
        """Noise, and answers of another unit."""
        reply = self._device.reply(struct.pack(">BHH", 4, 0, 12), Moment(0.0, 0.0))
        if reply is not None:
            noise = os.urandom(1)[0] < 128
            data = os.urandom(20) if noise else _frame(UNIT + 1, reply.foreign)
            self.log.say(">", data)
            self._port.send(data)

    def _came(self, moment: Moment) -> None:
        while (frame := self._next()) is not None:
            self._answer(frame[0], frame[1:-2], moment)

    def _next(self) -> bytes | None:
        """The next whole question; what is none is thrown away byte by byte."""
        port = self._port
        while len(port.held) >= 8:
            write = port.held[1] in (15, 16)
            length = 9 + port.held[6] if write else 8
            if len(port.held) < length:
                return None
            frame = port.held[:length]
            if _checksum(frame[:-2]) == frame[-2:]:
                port.held = port.held[length:]
                return frame
            port.held = port.held[1:]
        return None

    def _answer(self, unit: int, pdu: bytes, moment: Moment) -> None:
        if unit != UNIT:
            return
        reply = self._device.reply(pdu, moment)
        if reply is None:
            return
        answer = _frame(unit, reply.pdu)
        late = self.machine.script.active("write_late", moment.late)
        if pdu[0] in (6, 16) and late:
            self.delivery.later(late.amount, self._port.send, answer)
            return
        spoilt = _frame(unit, reply.foreign)
        self.delivery.answer(
            self._port.send,
            answer,
            reply.shown,
            foreign=(
                [_frame(unit + 1, reply.foreign), spoilt[:-1] + bytes((spoilt[-1] ^ 0x40,))]
                if reply.foreign
                else ()
            ),
            refusal=_frame(unit, reply.refusal),
        )


def _frame(unit: int, pdu: bytes) -> bytes:
    data = bytes((unit,)) + pdu
    return data + _checksum(data)


def _checksum(data: bytes) -> bytes:
    """CRC-16 with the polynomial A001h, low byte first (Modbus over Serial Line V1.02, 6.2.2)."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
    return crc.to_bytes(2, "little")
