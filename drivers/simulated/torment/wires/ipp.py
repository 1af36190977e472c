"""I++ DME (VDMA 8722) on a raw socket; what is written goes to a Modbus controller beside it."""

from __future__ import annotations

import dataclasses
import os
import time
from pathlib import Path
from typing import ClassVar

from abbe.drivers.simulated.torment.delivery import FAMILIAR
from abbe.drivers.simulated.torment.judge.evidence import AXES, ShownPicture, WireLog
from abbe.drivers.simulated.torment.loop import Loop, Moment
from abbe.drivers.simulated.torment.machine import TormentMachine
from abbe.drivers.simulated.torment.wires.base import TormentWire
from abbe.drivers.simulated.torment.wires.modbus_tcp import ModbusOutputs
from abbe.drivers.simulated.torment.wires.tcp import Client, TcpServer

_PLACE = frozenset(AXES)
_WARM = frozenset(("T_x",))


class Ipp(TormentWire):
    """A measuring machine's server: ``Get`` and ``GetScaleTemperatures``; it only tells."""

    KINDS: ClassVar[tuple[str, ...]] = (
        *FAMILIAR,
        "reset",
        "away",
        "write_refused",
        "write_late",
        "write_unanswered",
        "sensor_jump",
    )
    VARIANTS: ClassVar[tuple[str, ...]] = ("plain", "patient")
    READ: ClassVar[tuple[str, ...]] = (*AXES, "T_x")
    WRITTEN: ClassVar[tuple[str, ...]] = (*AXES, "status", "beat")
    write_link = "out"

    def __init__(
        self, loop: Loop, machine: TormentMachine, log: WireLog, folder: Path, variant: str
    ) -> None:
        super().__init__(loop, machine, log, folder, variant)
        self._server = TcpServer(loop, log, self._came)
        self._outputs = ModbusOutputs(loop, machine, log, folder, variant)
        self._tag = 1

    @property
    def links(self) -> str:
        """TOML of its links."""
        timeout = 1.0 if self.variant == "patient" else 0.15
        places = "".join(f'{axis} = {{ axis = "{axis}" }}\n' for axis in AXES)
        return f"""[links.m]
driver = "ipp"
host = "127.0.0.1"
port = {self._server.port}
timeout = {timeout}
reconnect_min = 0.1
reconnect_max = 0.3
quarantine_max = 1.0
[links.m.channels]
{places}T_x = {{ scale_temperature = "X", every = 0.1 }}
{self._outputs.links}"""

    def open(self) -> None:
        """Begin to serve."""
        self._server.listen()
        self._outputs.open()

    def cut(self) -> None:
        """Cut the connection to the measuring machine."""
        self._server.cut()

    def mend(self) -> None:
        """Let clients in again."""
        self._server.listen()

    def close(self) -> None:
        """End it."""
        super().close()
        self._outputs.close()

    def flood(self) -> None:
        """Events, answers to commands that were never sent, noise."""
        shown = self.machine.poisoned(time.monotonic())
        lines = [b'E0000 # KeyPress("F1")\r\n', b"\xff\x00\r\n", os.urandom(12).hex().encode()]
        lines += [b"\r\n", *(_data(f"{self._tag + 500 + k:05d}", _place(shown)) for k in range(3))]
        data = b"".join(lines)
        for client in list(self._server.clients):
            self.log.say(">", data)
            client.send(data)

    def _came(self, client: Client, moment: Moment) -> None:
        while b"\r\n" in client.held:
            line, client.held = client.held.split(b"\r\n", 1)
            tag, _, command = line.decode("latin-1").partition(" ")
            if len(tag) == 5:
                self._command(client, tag, command.strip())

    def _command(self, client: Client, tag: str, command: str) -> None:
        now = time.monotonic()
        if tag.isdigit():
            self._tag = int(tag)
        method = command.partition("(")[0]
        taken = f"{tag} &\r\n".encode()
        done = f"{tag} %\r\n".encode()
        refusal = taken + f'{tag} ! Error(2, 2500, "{method}", "Refused")\r\n'.encode() + done
        shown: ShownPicture | None = None
        foreign: list[bytes] = []
        data = b""
        if method == "Get":
            whole = self.machine.look(now)
            shown = dataclasses.replace(whole, covers=_PLACE)
            data = f"{tag} # {_place(whole)}\r\n".encode()
            poison = _place(self.machine.poisoned(now))
            other = (int(tag) - 1, int(tag) + 1, (int(tag) + 5000) % 100000)
            foreign = [_data(f"{number:05d}", poison) for number in other]
            foreign.append(_data("E0000", poison))
        elif method == "GetScaleTemperatures":
            whole = self.machine.look(now)
            shown = dataclasses.replace(whole, covers=_WARM)
            data = f"{tag} # X({whole.temperature:.3f})\r\n".encode()
        elif method == "GetCoordSystem":
            data = f"{tag} # CoordSystem(MachineCsy)\r\n".encode()
        elif method not in ("StartSession", "EndSession", "ClearAllErrors"):
            text = f'{tag} ! Error(3, 0501, "{method}", "Unsupported command")\r\n'
            data = text.encode()
        self.delivery.answer(
            client.send, taken + data + done, shown, foreign=foreign, refusal=refusal
        )


def _place(shown: ShownPicture) -> str:
    return ", ".join(f"{axis}({p:.5f})" for axis, p in zip(AXES, shown.place, strict=True))


def _data(tag: str, text: str) -> bytes:
    return f"{tag} # {text}\r\n{tag} %\r\n".encode()
