"""Modbus TCP on a raw socket: frames, transaction numbers, and wrong ones."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import ClassVar

from abbe.drivers.simulated.torment.delivery import FAMILIAR, Send
from abbe.drivers.simulated.torment.judge.evidence import WireLog
from abbe.drivers.simulated.torment.loop import Loop, Moment
from abbe.drivers.simulated.torment.machine import TormentMachine
from abbe.drivers.simulated.torment.wires.base import TormentWire
from abbe.drivers.simulated.torment.wires.modbus_pdu import (
    ModbusDevice,
    ModbusReply,
    held_channels,
    shown_channels,
)
from abbe.drivers.simulated.torment.wires.tcp import Client, TcpServer

MODBUS_KINDS = (
    *FAMILIAR,
    "frozen",
    "heartbeat_frozen",
    "status_lost",
    "narrow",
    "reset",
    "away",
    "mirrored",
    "write_refused",
    "write_late",
    "write_unanswered",
    "foreign",
    "sensor_jump",
    "sensor_bad",
)


class ModbusTcp(TormentWire):
    """Serves the machine's registers over TCP."""

    KINDS: ClassVar[tuple[str, ...]] = MODBUS_KINDS
    VARIANTS: ClassVar[tuple[str, ...]] = ("plain", "patient", "holding", "verify")
    NAME: ClassVar[str] = "m"

    def __init__(
        self, loop: Loop, machine: TormentMachine, log: WireLog, folder: Path, variant: str
    ) -> None:
        super().__init__(loop, machine, log, folder, variant)
        self._device = ModbusDevice(machine, 3 if variant == "holding" else 4, self.KINDS)
        self._server = TcpServer(loop, log, self._came)
        self._last = 0

    @property
    def links(self) -> str:
        """TOML of its links."""
        timeout = 1.0 if self.variant == "patient" else 0.15
        return f"""[links.{self.NAME}]
driver = "modbus"
transport = "tcp"
host = "127.0.0.1"
port = {self._server.port}
timeout = {timeout}
reconnect_max = 0.3
quarantine_max = 0.5
[links.{self.NAME}.channels]
{self.channels}"""

    @property
    def channels(self) -> str:
        """TOML of its channels."""
        return shown_channels(self.variant) + held_channels(self.variant)

    def open(self) -> None:
        """Begin to serve."""
        self._server.listen()

    def cut(self) -> None:
        """Cut what connections there are."""
        self._server.cut()

    def mend(self) -> None:
        """Let clients in again."""
        self._server.listen()

    def flood(self) -> None:
        """Foreign answers with numbers near those in use, and noise."""
        reply = self._device.reply(struct.pack(">BHH", 4, 0, 12), Moment(0.0, 0.0))
        if reply is None:
            return
        for client in list(self._server.clients):
            frames = [_frame(self._last + k, 1, reply.foreign) for k in (1, 2, 3, -1)]
            data = b"".join(frames) if os.urandom(1)[0] < 200 else _frame(0, 9, os.urandom(9))
            self.log.say(">", data)
            client.send(data)

    def _came(self, client: Client, moment: Moment) -> None:
        while len(client.held) >= 7:
            number, _, length = struct.unpack(">HHH", client.held[:6])
            if len(client.held) < 6 + length:
                return
            unit, pdu = client.held[6], client.held[7 : 6 + length]
            client.held = client.held[6 + length :]
            self._answer(client, number, unit, pdu, moment)

    def _answer(self, client: Client, number: int, unit: int, pdu: bytes, moment: Moment) -> None:
        self._last = number
        reply = self._device.reply(pdu, moment)
        if reply is None:
            return
        answer = _frame(number, unit, reply.pdu)
        late = self._device.active("write_late", moment.late)
        if pdu[0] in (6, 16) and late:
            self.delivery.later(late.amount, client.send, answer)
        else:
            self.send(client.send, answer, number, unit, reply)

    def send(self, send: Send, answer: bytes, number: int, unit: int, reply: ModbusReply) -> None:
        """Send an answer, tormented."""
        foreign = [
            _frame(number - 1, unit, reply.foreign),
            _frame(number + 1, unit, reply.foreign),
            _frame(0 if number else 7, unit, reply.foreign),
            _frame(number, unit ^ 0x55, reply.foreign),
        ]
        self.delivery.answer(
            send,
            answer,
            reply.shown,
            foreign=foreign if reply.foreign else (),
            refusal=_frame(number, unit, reply.refusal),
        )


class ModbusOutputs(ModbusTcp):
    """A controller that only takes, for machines that only tell; its answers are honest."""

    KINDS: ClassVar[tuple[str, ...]] = ("write_refused", "write_late", "write_unanswered")
    NAME: ClassVar[str] = "out"

    @property
    def channels(self) -> str:
        """TOML of its channels."""
        return held_channels(self.variant)

    def send(self, send: Send, answer: bytes, number: int, unit: int, reply: ModbusReply) -> None:
        """Send an answer as it is."""
        self.log.say(">", answer)
        send(answer)


def _frame(number: int, unit: int, pdu: bytes) -> bytes:
    return struct.pack(">HHHB", number & 0xFFFF, 0, len(pdu) + 1, unit) + pdu
