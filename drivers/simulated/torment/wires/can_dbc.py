"""CAN frames as a DBC file describes them, sent by themselves by a tormented machine."""

from __future__ import annotations

import os
import struct
import time
from pathlib import Path
from typing import ClassVar

from abbe.drivers.simulated.torment.judge.evidence import AXES, ShownPicture, WireLog
from abbe.drivers.simulated.torment.loop import Loop, Moment
from abbe.drivers.simulated.torment.machine import RESOLUTION, TormentMachine
from abbe.drivers.simulated.torment.wires.slcan import SlcanFrame, SlcanWire

PLACE_XY, PLACE_Z, STATE = 0x101, 0x102, 0x103
OUT_XY, OUT_Z, OUT_STATE = 0x201, 0x202, 0x203
PERIOD = 0.02
"""s between two sets of frames."""

DBC = """VERSION ""
NS_ :
BS_:
BU_: Abbe Machine

BO_ 257 PLACE_XY: 8 Machine
 SG_ X : 0|32@1- (1e-05,0) [0|0] "mm" Abbe
 SG_ Y : 32|32@1- (1e-05,0) [0|0] "mm" Abbe
BO_ 258 PLACE_Z: 8 Machine
 SG_ Z : 0|32@1- (1e-05,0) [0|0] "mm" Abbe
 SG_ number : 32|32@1+ (1,0) [0|0] "" Abbe
BO_ 259 STATE: 6 Machine
 SG_ beat : 0|16@1+ (1,0) [0|0] "" Abbe
 SG_ status : 16|16@1+ (1,0) [0|0] "" Abbe
 SG_ T_x : 32|16@1- (0.01,0) [0|0] "degC" Abbe

BO_ 513 OUT_XY: 8 Abbe
 SG_ out_X : 0|32@1- (1e-05,0) [0|0] "mm" Machine
 SG_ out_Y : 32|32@1- (1e-05,0) [0|0] "mm" Machine
BO_ 514 OUT_Z: 4 Abbe
 SG_ out_Z : 0|32@1- (1e-05,0) [0|0] "mm" Machine
BO_ 515 OUT_STATE: 4 Abbe
 SG_ out_status : 0|16@1+ (1,0) [0|0] "" Machine
 SG_ out_beat : 16|16@1+ (1,0) [0|0] "" Machine

BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 257 20;
BA_ "GenMsgCycleTime" BO_ 258 20;
BA_ "GenMsgCycleTime" BO_ 259 20;
"""
_MESSAGES = {
    "PLACE_XY": ("X", "Y"),
    "PLACE_Z": ("Z", "number"),
    "STATE": ("beat", "status", "T_x"),
    "OUT_XY": ("out_X", "out_Y"),
    "OUT_Z": ("out_Z",),
    "OUT_STATE": ("out_status", "out_beat"),
}


def frames(shown: ShownPicture) -> list[tuple[SlcanFrame, frozenset[str]]]:
    """The machine in three frames, and what each tells."""
    x, y, z = (round(p / RESOLUTION) for p in shown.place)
    warm = round(100.0 * shown.temperature)
    number, beat = shown.number & 0xFFFFFFFF, shown.beat & 0xFFFF
    return [
        (SlcanFrame(PLACE_XY, struct.pack("<ii", x, y)), frozenset("XY")),
        (SlcanFrame(PLACE_Z, struct.pack("<iI", z, number)), frozenset(("Z", "number"))),
        (
            SlcanFrame(STATE, struct.pack("<HHh", beat, shown.status, warm)),
            frozenset(("heartbeat", "status", "T_x")),
        ),
    ]


class CanDbc(SlcanWire):
    """Frames on an slcan adapter; nothing that is written is ever confirmed."""

    KINDS: ClassVar[tuple[str, ...]] = (
        "split",
        "partial",
        "wrong_id",
        "duplicated",
        "flood",
        "silent",
        "frozen",
        "heartbeat_frozen",
        "status_lost",
        "reset",
        "away",
        "foreign",
        "mirrored",
        "sensor_jump",
    )
    BLIND: ClassVar[float] = 0.1
    WRITTEN: ClassVar[tuple[str, ...]] = (*AXES, "status", "beat")

    def __init__(
        self, loop: Loop, machine: TormentMachine, log: WireLog, folder: Path, variant: str
    ) -> None:
        super().__init__(loop, machine, log, folder, variant)
        (folder / "machine.dbc").write_text(DBC, encoding="ascii")

    @property
    def links(self) -> str:
        """TOML of its links."""
        channels = "".join(
            f'{name} = {{ message = "{message}"'
            + (", writable = true }\n" if name.startswith("out_") else " }\n")
            for message, names in _MESSAGES.items()
            for name in names
        )
        return (
            f'[links.m]\ndriver = "can"\ninterface = "slcan"\n'
            f'channel = "{self._adapter.port.path}"\nbitrate = 500000\ndbc = "machine.dbc"\n'
            f"timeout = 0.1\nreconnect_max = 0.3\nquarantine_max = 0.5\n"
            f"[links.m.channels]\n{channels}"
            "[links.m.messages]\nPLACE_XY = { within = 0.3 }\nPLACE_Z = { within = 0.3 }\n"
            "STATE = { within = 0.3 }\n"
        )

    def open(self) -> None:
        """Begin to send."""
        self._adapter.port.plug()
        self._send_all()

    def flood(self) -> None:
        """Others' frames, as fast as the adapter can tell them, and lines that are no frames."""
        texts = [SlcanFrame(0x700 + k, os.urandom(8)).text() for k in range(20)]
        texts.append(b"t10190011\r" if os.urandom(1)[0] < 60 else b"\r")
        self._adapter.send(b"".join(texts))

    def _send_all(self) -> None:
        if self._closed:
            return
        now = time.monotonic()
        active = self.machine.script.active
        if not self.delivery.busy:  # what comes by itself is of the moment at which it goes out
            shown = self.machine.look(now)
            foreign = self._foreign(self.machine.poisoned(now))
            part = active("partial", now)
            own = frames(shown)
            if active("split", now):
                text = b"".join(frame.text() for frame, _ in own)
                self.delivery.in_pieces(self._adapter.send, text, shown)
                own = []
            for k, (frame, covers) in enumerate(own):
                if part and k == int(part.amount * 2.99):
                    continue
                self.delivery.send_own(self._adapter.send, frame.text(), shown, covers, foreign[k])
        self.loop.after(PERIOD, self._send_all)

    @staticmethod
    def _foreign(shown: ShownPicture) -> list[bytes]:
        """Frames that are none of ours: 29-bit ids with our number, too short ones."""
        return [
            SlcanFrame(f.id, f.data, extended=True).text() + SlcanFrame(f.id, f.data[:3]).text()
            for f, _ in frames(shown)
        ]

    def _received(self, frame: SlcanFrame, moment: Moment) -> bool:
        if self.refuses_write(time.monotonic()):
            return False
        values: dict[str, float] = {}
        if frame.id == OUT_XY:
            x, y = struct.unpack("<ii", frame.data)
            values = {"X": x * RESOLUTION, "Y": y * RESOLUTION}
        elif frame.id == OUT_Z:
            values = {"Z": struct.unpack("<i", frame.data)[0] * RESOLUTION}
        elif frame.id == OUT_STATE:
            status, beat = struct.unpack("<HH", frame.data)
            values = {"status": float(status), "heartbeat": float(beat)}
        if values:
            self.machine.take(moment, values)
        return True
