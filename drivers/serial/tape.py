"""The sender's side of a tape: one serial line, characters at the receiver's pleasure."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, model_validator

from abbe.compcore.units import in_digits
from abbe.drivers.link import LinkDownError, LinkError, LinkProtocolError, LinkTimeoutError
from abbe.drivers.serial.checksum import Kind, shown
from abbe.drivers.serial.patterns import checked
from abbe.drivers.serial.port.opening import open_port
from abbe.drivers.serial.port.port import Port
from abbe.drivers.serial.port.settings import PortSettings

DC1, DC3 = 0x11, 0x13
CONTROL = bytes((0x00, 0x11, 0x12, 0x13, 0x14, 0x7F))
"""NUL, DC1 to DC4, DEL: never part of a block."""
_MOST_HELD = 1 << 20
"""Received characters that may wait to be looked at: more than any tape."""
_LOOK = 0.01
"""s between two looks at whether the driver has sent everything."""


class TapeSettings(PortSettings):
    """How a control wants its tapes. Times are in s."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    baudrate: Annotated[int, Field(ge=50)] = 4800
    end_of_block: Literal["\n", "\r\n", "\r"] = "\n"
    verify: Literal["echo", "checksum", "none"] = "none"
    checksum: Kind = "crc16"
    """For ``verify = "checksum"``."""
    checksum_reply: str = r"SUM=(?P<checksum>[0-9A-Fa-f]+)"
    """The line that tells the checksum, in hexadecimal."""
    wait_for_dc1: bool = True
    """Send nothing before the first DC1: the operator presses READ when ready."""
    run_on: Annotated[int, Field(ge=1, le=4096)] = 8
    """Characters that may still come after a DC3; Fanuc's controls take ten."""
    leader: Annotated[int, Field(ge=0, le=4096)] = 0
    """NUL characters before and behind the tape, for controls that expect blank tape."""
    start_timeout: Annotated[float, Field(gt=0)] = 60.0
    """Longest wait for the first DC1."""
    stall_timeout: Annotated[float, Field(gt=0)] = 30.0
    """Longest time between DC3 and DC1, for one echo, or for the checksum."""
    resume_within: Annotated[float, Field(ge=0)] = 30.0
    """How long to try to find a lost port again; 0: a break is final."""
    attempts: Annotated[int, Field(ge=1)] = 5
    """Tapes that may be begun for one table."""

    @model_validator(mode="after")
    def _consistent(self) -> TapeSettings:
        if self.flow == "xonxoff":
            raise ValueError(
                "flow = 'xonxoff' would have the driver swallow DC1 and DC3: leave it 'none'"
            )
        if self.verify == "checksum":
            try:
                fields = checked(self.checksum_reply).fields
            except ValueError as error:
                raise ValueError(f"checksum_reply: {error}") from None
            if "checksum" not in fields:
                raise ValueError("checksum_reply has no field (?P<checksum>...)")
        return self


def check_blocks(blocks: Sequence[str]) -> None:
    """Refuse what cannot stand on a tape.

    Raises
    ------
    LinkError
        Naming the block and the character.
    """
    for number, block in enumerate(blocks):
        wrong = next((c for c in block if not " " <= c <= "~" or c == "%"), None)
        if wrong is not None:
            raise LinkError(
                f"nothing sent; block {number} has {wrong!r}, which cannot be on a tape: {block!r}"
            )
        if not block.strip():
            raise LinkError(f"nothing sent; block {number} is empty")


class TapeLine:
    """One open port, its sending stopped by DC3 and continued by DC1.

    Parameters
    ----------
    settings
        Port and control.
    """

    def __init__(self, settings: TapeSettings) -> None:
        self._settings = settings
        self._port: Port | None = None
        self._go = not settings.wait_for_dc1
        self._held = bytearray()
        self._lost = ""
        self._news = asyncio.Event()
        self._free_at = 0.0

    async def open(self) -> None:
        """Open the port.

        Raises
        ------
        LinkDownError
            When it does not open.
        """
        self._port = await open_port(self._settings, self._receive, self._lose)

    async def close(self) -> None:
        """Free the port."""
        port, self._port = self._port, None
        if port is not None:
            port.close()
            await port.closed()

    def ask(self, data: bytes) -> None:
        """Send at once, whether or not the other side asks: what begins a transfer."""
        self._open_port().write(data)

    async def until_asked(self, within: float) -> None:
        """Wait for DC1, at most `within` s."""
        await self._until(lambda: self._go, within, "the receiver did not ask for anything (DC1)")

    async def send(self, data: bytes) -> None:
        """Send, a few characters at a time, while the receiver allows it."""
        settings = self._settings
        for start in range(0, len(data), settings.run_on):
            lot = data[start : start + settings.run_on]
            port = self._open_port()
            wait = self._free_at - time.monotonic()
            if wait > 0:
                await asyncio.sleep(wait)
            await self._until_driver_is_empty()
            port.drain()
            await self._until(
                lambda: self._go,
                settings.stall_timeout,
                "the receiver stopped us (DC3) and did not go on (DC1)",
            )
            self._open_port().write(lot)
            self._free_at = time.monotonic() + len(lot) * settings.character_time

    async def until_sent(self) -> None:
        """Wait until the last character has left."""
        wait = self._free_at - time.monotonic()
        if wait > 0:
            await asyncio.sleep(wait)
        await self._until_driver_is_empty()

    async def next_line(self, within: float, what: str) -> bytes:
        """The next line that comes, without its end; blank ones are passed over."""
        deadline = time.monotonic() + within
        while True:
            line = await self._next(b"\r\n", deadline - time.monotonic(), f"{what} did not come")
            if line.strip():
                return line

    async def until_character(self, character: bytes, pause: float, what: str) -> bytes:
        """All that comes before a character; `pause` s may pass between two characters."""
        while True:
            before = len(self._held)
            cut = self._held.find(character)
            if cut >= 0:
                return self._take(cut)
            await self._until(
                lambda before=before: len(self._held) > before,  # type: ignore[misc]
                pause,
                f"{what} did not come",
            )

    def refuse_lines(self, when: str) -> None:
        """Raise when the receiver said something.

        Raises
        ------
        LinkProtocolError
            With what it said.
        """
        said = bytes(self._held).strip()
        if said:
            raise LinkProtocolError(f"the receiver said {shown(said)} {when}")

    async def _next(self, ends: bytes, within: float, why: str) -> bytes:
        def found() -> int:
            return next((i for i, byte in enumerate(self._held) if byte in ends), -1)

        await self._until(lambda: found() >= 0, within, why)
        return self._take(found())

    def _take(self, cut: int) -> bytes:
        taken = bytes(self._held[:cut])
        del self._held[: cut + 1]
        return taken

    async def _until(self, true: Callable[[], bool], within: float, why: str) -> None:
        deadline = time.monotonic() + within
        while not true():
            self._open_port()
            self._news.clear()
            try:
                await asyncio.wait_for(self._news.wait(), max(0.0, deadline - time.monotonic()))
            except TimeoutError:
                said = f"; it said {shown(bytes(self._held))}" if self._held else ""
                raise LinkTimeoutError(f"{why} in {in_digits(within)} s{said}") from None

    async def _until_driver_is_empty(self) -> None:
        deadline = time.monotonic() + self._settings.stall_timeout
        while self._open_port().unsent:
            if time.monotonic() > deadline:
                raise LinkTimeoutError("the port takes no more characters (hardware handshake?)")
            await asyncio.sleep(_LOOK)

    def _open_port(self) -> Port:
        if self._lost or self._port is None:
            raise LinkDownError(self._lost or "the port is closed")
        return self._port

    def _receive(self, data: bytes) -> None:
        for byte in data:
            if byte == DC1:
                self._go = True
            elif byte == DC3:
                self._go = False
            elif byte not in CONTROL and len(self._held) < _MOST_HELD:
                self._held.append(byte)
        self._news.set()

    def _lose(self, why: str) -> None:
        self._lost = why
        self._news.set()
