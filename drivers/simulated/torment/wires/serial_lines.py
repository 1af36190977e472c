"""Lines of ASCII on a raw pseudo-terminal: a read-out that is asked, one that sends by itself."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import ClassVar

from abbe.drivers.simulated.torment.delivery import FAMILIAR
from abbe.drivers.simulated.torment.judge.evidence import AXES, ShownPicture, WireLog
from abbe.drivers.simulated.torment.loop import Loop, Moment
from abbe.drivers.simulated.torment.machine import TormentMachine
from abbe.drivers.simulated.torment.wires.base import TormentWire
from abbe.drivers.simulated.torment.wires.pty import PtyEnd

_OTHERS = (
    "frozen",
    "heartbeat_frozen",
    "status_lost",
    "reset",
    "away",
    "write_refused",
    "write_late",
    "write_unanswered",
    "foreign",
    "sensor_jump",
    "sensor_bad",
)
_COMMANDS = {
    "PX": "X",
    "PY": "Y",
    "PZ": "Z",
    "PS": "status",
    "PH": "heartbeat",
    "PN": "echo",
}
PERIOD = 0.02
"""s between two lines of what sends by itself."""
_NUMBER = r"[-+]\d{1,4}\.\d{5}"
_PATTERN = (
    rf"X(?P<X>{_NUMBER}) Y(?P<Y>{_NUMBER}) Z(?P<Z>{_NUMBER}) N(?P<number>\d{{1,10}}) "
    r"H(?P<beat>\d{5}) S(?P<status>\d{1,5}) T(?P<T_x>-?[\d.]{5,8}|---)"
)


class SerialAsked(TormentWire):
    """A read-out: ``R`` is answered by all axes, commands by ``OK`` and their name."""

    KINDS: ClassVar[tuple[str, ...]] = (*FAMILIAR, *_OTHERS, "mirrored")
    VARIANTS: ClassVar[tuple[str, ...]] = ("plain", "checksum", "patient")
    BLIND: ClassVar[float] = 0.06
    QUERY: ClassVar[str] = 'query = "R"\n'

    def __init__(
        self, loop: Loop, machine: TormentMachine, log: WireLog, folder: Path, variant: str
    ) -> None:
        super().__init__(loop, machine, log, folder, variant)
        self._port = PtyEnd(loop, log, folder / "line", self._came)
        self._summed = variant == "checksum"

    @property
    def links(self) -> str:
        """TOML of its links."""
        timeout = 1.0 if self.variant == "patient" else 0.1
        checked = 'checksum = { kind = "sum" }\n' if self._summed else ""
        reads = "".join(
            f'{name} = {{ message = "all", unit = "{unit}" }}\n'
            for name, unit in (
                *((axis, "mm") for axis in AXES),
                *((name, "") for name in ("number", "beat", "status")),
                ("T_x", "degC"),
            )
        )
        writes = "".join(
            f'out_{name} = {{ command = "{command}{form}"{unit}{self._confirmed(command)} }}\n'
            for name, command, form, unit in (
                *((axis, f"P{axis}", "{value:+.5f}", ', unit = "mm"') for axis in AXES),
                ("status", "PS", "{value:.0f}", ""),
                ("beat", "PH", "{value:.0f}", ""),
                ("echo", "PN", "{value:.0f}", ""),
            )
        )
        return f"""[links.m]
driver = "serial"
port = "{self._port.path}"
baudrate = 115200
timeout = {timeout}
reconnect_max = 0.3
quarantine_max = 0.5
late_reply_max = 2.0
[links.m.messages.all]
{self.QUERY}pattern = '{_PATTERN}'
{checked}[links.m.channels]
{reads}{writes}"""

    def _confirmed(self, command: str) -> str:
        """How a command is answered, in the configuration."""
        return f', acknowledge = "OK {command}", refused = "NO {command}"'

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
        """Noise, and lines of something else."""
        noise = os.urandom(20) if os.urandom(1)[0] < 128 else b"READY\r\nX+1.0 Y+2.0\r\n"
        self.log.say(">", noise)
        self._port.send(noise)

    def line(self, shown: ShownPicture) -> bytes:
        """The machine as one line."""
        x, y, z = shown.place
        bad = shown.temperature != shown.temperature
        warm = "---" if bad else f"{shown.temperature:.3f}"
        text = (
            f"X{x:+.5f} Y{y:+.5f} Z{z:+.5f} N{shown.number} H{shown.beat % 65536:05d} "
            f"S{shown.status} T{warm}"
        )
        return self._ended(text)

    def foreign(self, shown: ShownPicture) -> list[bytes]:
        """Lines that do not fit: cut short, of another shape, or with a wrong checksum."""
        good = self.line(shown)
        lines = [good[: len(good) // 2] + b"\r\n", good.replace(b"Y", b"W")]
        if self._summed:
            lines.append(good[:-4] + b"00\r\n" if good[-4:-2] != b"00" else good[:-4] + b"11\r\n")
        return lines

    def _ended(self, text: str) -> bytes:
        if self._summed:
            text += f"{sum(text.encode()) & 0xFF:02X}"
        return text.encode() + b"\r\n"

    def _came(self, moment: Moment) -> None:
        while b"\r\n" in self._port.held:
            line, self._port.held = self._port.held.split(b"\r\n", 1)
            text = line.decode("latin-1")
            if self._summed and text[:1] == "R":
                text = text[:-2]
            if text == "R":
                self._ask()
            elif text[:2] in _COMMANDS:
                self._command(text, moment)

    def _ask(self) -> None:
        now = time.monotonic()
        shown = self.machine.look(now)
        self.delivery.answer(
            self._port.send,
            self.line(shown),
            shown,
            foreign=self.foreign(self.machine.poisoned(now)),
            refusal=b"?\r\n",
        )

    def _command(self, text: str, moment: Moment) -> None:
        name = text[:2]
        now = time.monotonic()
        active = self.machine.script.active
        lost = active("write_unanswered", now)
        if self.refuses_write(now):
            answer = f"NO {name}\r\n".encode()
        else:
            answer = f"OK {name}\r\n".encode()
            if not active("silent", now) and not (lost and lost.amount >= 0.5):
                self.machine.take(moment, {_COMMANDS[name]: float(text[2:])})
        if lost:
            return
        if late := active("write_late", now):
            self.delivery.later(late.amount, self._port.send, answer)
        else:
            self.delivery.answer(self._port.send, answer)


class SerialStreaming(SerialAsked):
    """The same read-out, sending by itself; it takes every command and answers none."""

    KINDS: ClassVar[tuple[str, ...]] = (
        "split",
        "partial",
        "wrong_id",
        "duplicated",
        "flood",
        "silent",
        *(kind for kind in _OTHERS if not kind.startswith("write")),
    )
    VARIANTS: ClassVar[tuple[str, ...]] = ("plain", "checksum")
    BLIND: ClassVar[float] = 0.1
    QUERY: ClassVar[str] = "within = 0.2\n"

    def open(self) -> None:
        """Begin to serve, and to send."""
        super().open()
        self._send_one()

    def _confirmed(self, command: str) -> str:
        """Nothing confirms a command among lines that come by themselves."""
        return ""

    def _command(self, text: str, moment: Moment) -> None:
        self.machine.take(moment, {_COMMANDS[text[:2]]: float(text[2:])})

    def _send_one(self) -> None:
        if self._closed:
            return
        if not self.delivery.busy:
            self._ask()
        self.loop.after(PERIOD, self._send_one)
