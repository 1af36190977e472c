"""CANopen nodes behind a raw slcan adapter: three encoders and a controller (CiA 301, 406)."""

from __future__ import annotations

import dataclasses
import os
import struct
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import ClassVar

from abbe.drivers.simulated.torment.judge.evidence import AXES, ShownPicture, WireLog
from abbe.drivers.simulated.torment.loop import Loop, Moment
from abbe.drivers.simulated.torment.machine import RESOLUTION, TormentMachine
from abbe.drivers.simulated.torment.wires.slcan import SlcanFrame, SlcanWire

ENCODERS = {"X": 3, "Y": 4, "Z": 5}
CONTROLLER = 6
HEARTBEAT = 0.1
"""s between two heartbeats of a node."""
_OUT = {1: "X", 2: "Y", 3: "Z", 4: "status", 5: "heartbeat", 6: "echo"}
"""Subindices of the controller's object 2100h, all U32 or S32."""
_OPERATIONAL, _PRE_OPERATIONAL, _STOPPED = 5, 0x7F, 4
_ABSENT, _GENERAL = 0x06020000, 0x08000000
"""SDO abort codes: there is no such object; general error."""


def _u32(value: int) -> bytes:
    return struct.pack("<I", value & 0xFFFFFFFF)


def _described(node: int) -> dict[tuple[int, int], bytes]:
    """What a node says of itself and of its first PDO: synchronous, at every SYNC."""
    encoder = node != CONTROLLER
    mapped = [0x60040020] if encoder else [0x20000120, 0x20000210, 0x20000310]
    return {
        (0x1000, 0): _u32(0x00010196 if encoder else 0),
        (0x1001, 0): b"\0",
        (0x1017, 0): struct.pack("<H", round(1e3 * HEARTBEAT)),
        (0x1018, 0): b"\x01",
        (0x1018, 1): _u32(0x2FF),
        (0x1800, 0): b"\x02",
        (0x1800, 1): _u32(0x180 + node),
        (0x1800, 2): b"\x01",
        (0x1A00, 0): bytes((len(mapped),)),
        **{(0x1A00, k): _u32(entry) for k, entry in enumerate(mapped, start=1)},
    }


class Canopen(SlcanWire):
    """Positions by PDO at SYNC, everything that is written by SDO."""

    KINDS: ClassVar[tuple[str, ...]] = (
        "late",
        "split",
        "partial",
        "wrong_id",
        "duplicated",
        "refused",
        "refused_long",
        "flood",
        "silent",
        "frozen",
        "heartbeat_frozen",
        "status_lost",
        "reset",
        "away",
        "mirrored",
        "write_refused",
        "write_late",
        "write_unanswered",
        "foreign",
        "sensor_jump",
    )
    VARIANTS: ClassVar[tuple[str, ...]] = ("plain", "patient")
    BLIND: ClassVar[float] = 0.06

    def __init__(
        self, loop: Loop, machine: TormentMachine, log: WireLog, folder: Path, variant: str
    ) -> None:
        super().__init__(loop, machine, log, folder, variant)
        self._states = dict.fromkeys((*ENCODERS.values(), CONTROLLER), _PRE_OPERATIONAL)
        self._fixed = {node: _described(node) for node in self._states}

    @property
    def links(self) -> str:
        """TOML of its links."""
        timeout = 1.0 if self.variant == "patient" else 0.1
        nodes = "".join(
            f"{name} = {{ id = {node}, heartbeat = 0.5 }}\n"
            for name, node in (*((a.lower(), n) for a, n in ENCODERS.items()), ("c", CONTROLLER))
        )
        places = "".join(
            f'{a} = {{ node = "{a.lower()}", profile = "cia406", by = "pdo", scale = 1e-5, '
            f'unit = "mm" }}\n'
            for a in ENCODERS
        )
        outputs = "".join(
            f'out_{"beat" if name == "heartbeat" else name} = {{ node = "c", index = 0x2100, '
            f"subindex = {sub}, writable = true, "
            + (
                'type = "int32", scale = 1e-5, unit = "mm" }\n'
                if name in AXES
                else 'type = "uint32" }\n'
            )
            for sub, name in _OUT.items()
        )
        return f"""[links.m]
driver = "canopen"
interface = "slcan"
channel = "{self._adapter.port.path}"
bitrate = 500000
sync = "read"
timeout = {timeout}
reconnect_max = 0.3
quarantine_max = 0.5
late_reply_max = 2.0
[links.m.nodes]
{nodes}[links.m.channels]
{places}number = {{ node = "c", index = 0x2000, subindex = 1, type = "uint32", by = "pdo" }}
beat = {{ node = "c", index = 0x2000, subindex = 2, type = "uint16", by = "pdo" }}
status = {{ node = "c", index = 0x2000, subindex = 3, type = "uint16", by = "pdo" }}
T_x = {{ node = "c", index = 0x2000, subindex = 4, type = "int16", scale = 0.01, unit = "degC", every = 0.1 }}
{outputs}"""  # noqa: E501

    def open(self) -> None:
        """Begin to serve."""
        self._adapter.port.plug()
        self._beat()

    def flood(self) -> None:
        """Others' frames; and PDOs of nodes that are not ours."""
        texts = [SlcanFrame(0x480 + k, os.urandom(8)).text() for k in range(16)]
        texts.append(SlcanFrame(0x180 + 99, os.urandom(4)).text())
        self._adapter.send(b"".join(texts))

    def _beat(self) -> None:
        if self._closed:
            return
        if not self.machine.script.active("silent", time.monotonic()):
            for node, state in self._states.items():
                self.delivery.aside(
                    self._adapter.send, SlcanFrame(0x700 + node, bytes((state,))).text()
                )
        self.loop.after(HEARTBEAT, self._beat)

    def _received(self, frame: SlcanFrame, moment: Moment) -> bool:
        if frame.extended or frame.remote:
            return True
        if frame.id == 0 and len(frame.data) == 2:
            self._manage(*frame.data)
        elif frame.id == 0x80:
            self._synchronise()
        elif frame.id - 0x600 in self._states and len(frame.data) == 8:
            self._sdo(frame.id - 0x600, frame.data, moment)
        return True

    def _manage(self, command: int, node: int) -> None:
        """Network management (CiA 301, 7.2.8)."""
        for one in self._states if node == 0 else [node]:
            if one in self._states:
                if command in (0x81, 0x82):
                    self._states[one] = _PRE_OPERATIONAL
                    self.delivery.aside(self._adapter.send, SlcanFrame(0x700 + one, b"\0").text())
                else:
                    known = {1: _OPERATIONAL, 2: _STOPPED, 0x80: _PRE_OPERATIONAL}
                    self._states[one] = known.get(command, self._states[one])

    def _synchronise(self) -> None:
        """All operational nodes latch now and send."""
        now = time.monotonic()
        shown, poison = self.machine.look(now), self.machine.poisoned(now)
        own, foreign = _pdos(shown), _pdos(poison)
        part = self.machine.script.active("partial", now)
        for k, (node, (data, covers)) in enumerate(own.items()):
            if self._states[node] != _OPERATIONAL or (part and k == int(3.99 * part.amount)):
                continue
            wrong = SlcanFrame(0x190 + node, foreign[node][0]).text()
            wrong += SlcanFrame(0x180 + node, foreign[node][0], extended=True).text()
            late = self.machine.script.active("late", now)
            send = partial(
                self.delivery.send_own,
                self._adapter.send,
                SlcanFrame(0x180 + node, data).text(),
                shown,
                covers,
                wrong,
            )
            if late:
                self.loop.at(now + late.amount, send)
            else:
                send()

    def _sdo(self, node: int, data: bytes, moment: Moment) -> None:
        """Expedited SDOs (CiA 301, 7.2.4)."""
        command, index, sub = struct.unpack("<BHB", data[:4])
        now = time.monotonic()
        refused = bytes((0x80,)) + data[1:4] + _u32(_GENERAL)
        absent = bytes((0x80,)) + data[1:4] + _u32(_ABSENT)
        reply = partial(self._reply, node)
        if command == 0x40:
            shown = self.machine.look(now)
            found = self._fixed[node].get((index, sub))
            covers: frozenset[str] = frozenset()
            if found is None:
                found, covers = _shown_object(node, index, sub, shown)
            if found is None:
                reply(absent, absent)
                return
            head = 0x43 | (4 - len(found)) << 2
            answer = bytes((head,)) + data[1:4] + found.ljust(4, b"\0")
            reply(answer, refused, shown if covers else None, covers)
        elif command & 0xE3 == 0x23:
            self._download(node, data, index, sub, moment, reply)
        elif command != 0x80:
            reply(bytes((0x80,)) + data[1:4] + _u32(0x05040001), refused)

    def _download(
        self,
        node: int,
        data: bytes,
        index: int,
        sub: int,
        moment: Moment,
        reply: Callable[..., None],
    ) -> None:
        now = time.monotonic()
        active = self.machine.script.active
        done = bytes((0x60,)) + data[1:4] + bytes(4)
        refused = bytes((0x80,)) + data[1:4] + _u32(_GENERAL)
        if index == 0x1017:
            reply(done, done)
            return
        name = _OUT.get(sub)
        if node != CONTROLLER or index != 0x2100 or name is None:
            absent = bytes((0x80,)) + data[1:4] + _u32(_ABSENT)
            reply(absent, absent)
            return
        if self.refuses_write(now):
            reply(refused, refused)
            return
        lost = active("write_unanswered", now)
        if not active("silent", now) and not (lost and lost.amount >= 0.5):
            (number,) = struct.unpack("<i" if name in AXES else "<I", data[4:])
            value = number * RESOLUTION if name in AXES else float(number)
            self.machine.take(moment, {name: value})
        if lost:
            return
        if late := active("write_late", now):
            text = SlcanFrame(0x580 + node, done).text()
            self.delivery.later(late.amount, self._adapter.send, text)
        else:
            reply(done, refused)

    def _reply(
        self,
        node: int,
        answer: bytes,
        refused: bytes,
        shown: ShownPicture | None = None,
        covers: frozenset[str] = frozenset(),
    ) -> None:
        other = SlcanFrame(0x580 + node, answer[:1] + b"\x77\x77\x01" + os.urandom(4)).text()
        stated = None if shown is None else _covering(shown, covers)
        self.delivery.answer(
            self._adapter.send,
            SlcanFrame(0x580 + node, answer).text(),
            stated,
            foreign=[other],
            refusal=SlcanFrame(0x580 + node, refused).text(),
        )


def _covering(shown: ShownPicture, covers: frozenset[str]) -> ShownPicture:
    return dataclasses.replace(shown, covers=covers)


def _pdos(shown: ShownPicture) -> dict[int, tuple[bytes, frozenset[str]]]:
    """What each node sends at SYNC, and what that tells."""
    counts = [round(p / RESOLUTION) for p in shown.place]
    found: dict[int, tuple[bytes, frozenset[str]]] = {
        node: (struct.pack("<i", count), frozenset((axis,)))
        for (axis, node), count in zip(ENCODERS.items(), counts, strict=True)
    }
    state = struct.pack("<IHH", shown.number & 0xFFFFFFFF, shown.beat & 0xFFFF, shown.status)
    found[CONTROLLER] = (state, frozenset(("number", "heartbeat", "status")))
    return found


def _shown_object(
    node: int, index: int, sub: int, shown: ShownPicture
) -> tuple[bytes | None, frozenset[str]]:
    """An object that shows the machine, and what it tells."""
    if node == CONTROLLER and (index, sub) == (0x2000, 4):
        return struct.pack("<h", round(100.0 * shown.temperature)), frozenset(("T_x",))
    for axis, encoder in ENCODERS.items():
        if node == encoder and (index, sub) == (0x6004, 0):
            data, covers = _pdos(shown)[encoder]
            return data, covers & {axis}
    return None, frozenset()
