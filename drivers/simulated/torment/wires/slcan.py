"""A CAN adapter on a serial line (LAWICEL's protocol) as text on a raw pseudo-terminal."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar, NamedTuple

from abbe.drivers.simulated.torment.judge.evidence import WireLog
from abbe.drivers.simulated.torment.loop import Loop, Moment
from abbe.drivers.simulated.torment.machine import TormentMachine
from abbe.drivers.simulated.torment.wires.base import TormentWire
from abbe.drivers.simulated.torment.wires.pty import PtyEnd


class SlcanFrame(NamedTuple):
    """One CAN frame."""

    id: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False

    def text(self) -> bytes:
        """As the adapter writes it."""
        kind = "tTrR"[2 * self.remote + self.extended]
        number = f"{self.id:08X}" if self.extended else f"{self.id:03X}"
        data = "" if self.remote else self.data.hex().upper()
        return f"{kind}{number}{len(self.data)}{data}\r".encode()


class SlcanEnd:
    """The adapter's computer side.

    Parameters
    ----------
    loop, log, path
        See `PtyEnd`.
    on_frame
        Called with each frame that shall go onto the bus; False refuses it (BELL).
    confirm
        Says what answers a command, after what is under way.
    """

    def __init__(
        self,
        loop: Loop,
        log: WireLog,
        path: Path,
        on_frame: Callable[[SlcanFrame, Moment], bool],
        confirm: Callable[[Callable[[bytes], bool], bytes], None],
    ) -> None:
        self._confirm = confirm
        self._on_frame = on_frame
        self.port = PtyEnd(loop, log, path, self._came)
        self.open = False

    def unplug(self) -> None:
        """Pull the adapter; when it is back it has forgotten that it was open."""
        self.port.unplug()
        self.open = False

    def send(self, text: bytes) -> bool:
        """Text of frames from the bus; False when nobody opened the adapter."""
        return self.open and self.port.send(text)

    def _came(self, moment: Moment) -> None:
        while b"\r" in self.port.held:
            command, self.port.held = self.port.held.split(b"\r", 1)
            answer = self._carry_out(command.decode("latin-1"), moment)
            self._confirm(self.port.send, answer)

    def _carry_out(self, command: str, moment: Moment) -> bytes:
        kind, rest = command[:1], command[1:]
        if kind in ("t", "T", "r", "R"):
            digits = 3 if kind in "tr" else 8
            length = int(rest[digits])
            data = bytes(length) if kind in "rR" else bytes.fromhex(rest[digits + 1 :])
            frame = SlcanFrame(int(rest[:digits], 16), data, kind in "TR", kind in "rR")
            taken = self.open and self._on_frame(frame, moment)
            return (b"z\r" if kind in "tr" else b"Z\r") if taken else b"\a"
        if kind in ("O", "C"):
            self.open = kind == "O"
        elif kind == "V":
            return b"V1013\r"
        elif kind == "N":
            return b"NA123\r"
        elif kind == "F":
            return b"F00\r"
        return b"\r"


class SlcanWire(TormentWire):
    """The base of wires whose bus is behind an adapter; frames are lost or come as a whole."""

    FRAMES: ClassVar[bool] = True

    def __init__(
        self, loop: Loop, machine: TormentMachine, log: WireLog, folder: Path, variant: str
    ) -> None:
        super().__init__(loop, machine, log, folder, variant)
        self._adapter = SlcanEnd(loop, log, folder / "slcan", self._received, self.delivery.aside)

    @abstractmethod
    def _received(self, frame: SlcanFrame, moment: Moment) -> bool:
        """A frame for the bus; False refuses it (BELL)."""

    def cut(self) -> None:
        """Unplug the adapter."""
        self._adapter.unplug()

    def mend(self) -> None:
        """Plug it in again."""
        self._adapter.port.plug()
