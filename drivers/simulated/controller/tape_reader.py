"""A machine control's reader/punch interface: tables come in and go out as a tape of blocks.

As in the serial interfaces of Fanuc (B-63503EN, RS-232-C) and Haas controls: DC1 asks for
characters, DC3 stops them (at most ten more may come), a tape is what stands between two ``%``,
blocks end with a line feed. Characters are taken from a small buffer at the control's own speed;
what does not fit is lost and counted. On top, as other controls do: each block echoed as it was
stored, or one line ``SUM=`` with the CRC-16 (Modbus) of all between the two ``%``.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any, Literal

DC1, DC2, DC3, DC4 = b"\x11", b"\x12", b"\x13", b"\x14"
_TICK = 0.002
"""s between two looks at the buffer."""
_MODBUS = 0xA001

Verify = Literal["none", "echo", "checksum"]


def crc16(data: bytes) -> int:
    """CRC-16 as in Modbus RTU, by long division."""
    crc = 0xFFFF
    for byte in data:
        for bit in range(8):
            odd = (crc ^ (byte >> bit)) & 1
            crc = (crc >> 1) ^ (_MODBUS if odd else 0)
    return crc


class TapeReader:
    """One control's interface.

    Parameters
    ----------
    send
        Sends bytes.
    rate
        Characters that it takes in a second.
    capacity
        Characters that its buffer holds; DC3 is sent when a quarter is left, DC1 at a quarter.
    verify
        How it lets the sender check what it stored.

    Attributes
    ----------
    stored
        Blocks, in the order in which they were completed; a new tape adds to them.
    tapes
        Tapes that began.
    complete
        Whether the last tape came to its closing ``%``.
    lost
        Characters that did not fit.
    most_after_stop
        Most characters that came between a DC3 and the next DC1.
    """

    def __init__(
        self, send: Callable[[bytes], None], rate: float, capacity: int, verify: Verify
    ) -> None:
        self._send = send
        self._rate = rate
        self._capacity = capacity
        self._verify = verify
        self._credit, self._looked_at = 0.0, time.monotonic()
        self._buffer = bytearray()
        self._block = bytearray()
        self._tape = bytearray()
        self._stopped = False
        self._after_stop = 0
        self._reading = False
        self._inside = False
        self.stored: list[str] = []
        self.tapes = 0
        self.complete = False
        self.lost = 0
        self.most_after_stop = 0
        self.stalled = False
        self.corrupt: int | None = None
        self.break_after: int | None = None
        self.on_break: Callable[[], None] = lambda: None
        self._may_send = asyncio.Event()
        self._may_send.set()

    def read(self) -> None:
        """The operator presses READ: ask for characters."""
        self._reading, self._stopped = True, False
        self._send(DC1)

    async def punch(self, character_time: float) -> None:
        """The operator presses PUNCH: send what is stored, obeying DC3 and DC1."""
        tape = b"%\n" + b"".join(block.encode() + b"\n" for block in self.stored) + b"%"
        for byte in DC2 + tape + DC4:
            await self._may_send.wait()
            self._send(bytes((byte,)))
            await asyncio.sleep(character_time)

    def alarm(self, text: str) -> None:
        """Refuse: say so and stop."""
        self._reading = False
        self._send(text.encode("ascii") + b"\r\n" + DC3)

    def renew(self) -> None:
        """What a power cycle or a new connection does: forget the tape under way."""
        self._buffer.clear()
        self._block.clear()
        self._tape.clear()
        self._inside = self._stopped = False
        self._may_send.set()
        self.break_after = None

    def report(self) -> dict[str, Any]:
        """All that can be said."""
        return {
            "stored": self.stored,
            "tapes": self.tapes,
            "complete": self.complete,
            "lost": self.lost,
            "most_after_stop": self.most_after_stop,
        }

    def receive(self, data: bytes) -> None:
        """Characters from the line.

        They came one after the other since the last look, also where this process was stalled. A
        control that was not stalled would have sent its DC3 among them; what follows in the same
        batch was sent by somebody who could not know, and is neither lost nor counted.
        """
        first, now = self._looked_at, time.monotonic()
        stopped_now = False
        for place, byte in enumerate(data, start=1):
            self._work_off(first + (now - first) * place / len(data))
            code = bytes((byte,))
            if code in (DC1, DC3):
                (self._may_send.set if code == DC1 else self._may_send.clear)()
            elif not self._reading:
                continue
            elif len(self._buffer) >= self._capacity and not stopped_now:
                self.lost += 1
            else:
                self._buffer.append(byte)
            if self._stopped and not stopped_now:
                self._after_stop += 1
                self.most_after_stop = max(self.most_after_stop, self._after_stop)
            if self._reading and not self._stopped and len(self._buffer) > 0.75 * self._capacity:
                self._stopped, self._after_stop, stopped_now = True, 0, True
                self._send(DC3)

    async def work(self) -> None:
        """Take characters from the buffer at the control's own speed, for ever."""
        while True:
            await asyncio.sleep(_TICK)
            self._work_off(time.monotonic())

    def _work_off(self, now: float) -> None:
        """Take what could be taken from the buffer until `now`, monotonic, s."""
        since = max(0.0, now - self._looked_at)
        self._looked_at = max(now, self._looked_at)
        self._credit = min(self._credit + since * self._rate, 0.5 * self._capacity)
        while self._credit >= 1.0 and self._buffer and not self.stalled:
            self._credit -= 1.0
            byte = self._buffer.pop(0)
            self._take(byte)
        if self._stopped and self._reading and len(self._buffer) <= 0.25 * self._capacity:
            self._stopped = False
            self._send(DC1)

    def _take(self, byte: int) -> None:
        if byte == ord("%"):
            self._inside = not self._inside
            if self._inside:
                self.tapes += 1
                self.complete = False
                self._tape.clear()
                self._block.clear()
            else:
                self._end()
        elif self._inside:
            self._tape.append(byte)
            if byte != ord("\n"):
                self._block.append(byte)
            elif self._block:
                self._store(self._block.decode("latin-1"))
                self._block.clear()

    def _store(self, block: str) -> None:
        if self.corrupt == len(self.stored):
            block = block.replace("0", "8", 1)
            self.corrupt = None
        self.stored.append(block)
        if self._verify == "echo":
            self._send(block.encode("latin-1") + b"\r\n")
        if self.break_after is not None and len(self.stored) >= self.break_after:
            self.break_after = None
            self.on_break()

    def _end(self) -> None:
        self.complete = True
        self._reading = False
        if self._verify == "checksum":
            self._send(b"SUM=%04X\r\n" % crc16(bytes(self._tape)))
        self._send(DC3)
