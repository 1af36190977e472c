"""Tables over Modbus: blocks into a staging area, read back through a window, one commit register.

Nothing is believed that a register confirms by itself: numbers are read until two readings in a
row agree, every block is checked by the controller's own checksum of it, every window carries its
place and a checksum. A command has a token; a block has session, sequence and offset, so that a
lost, late or repeated one cannot shift what is staged. `abbe.drivers.stores.modbus.registers` is
the map.
"""

from __future__ import annotations

import asyncio
import secrets
import time
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from typing import ClassVar, TypeVar

from abbe.drivers import resources
from abbe.drivers.link import (
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkStatus,
    LinkTimeoutError,
)
from abbe.drivers.modbus.bus.bus import Bus
from abbe.drivers.modbus.bus.refusals import ModbusExceptionError as ModbusRefusedError
from abbe.drivers.modbus.plan import Span
from abbe.drivers.stores.base import (
    Files,
    Identity,
    Progress,
    Readiness,
    RefusedError,
    ShownCorrection,
    Store,
    StoreConfig,
)
from abbe.drivers.stores.image import crc32, pack, unpack
from abbe.drivers.stores.modbus import registers as registers
from abbe.drivers.stores.modbus.config import ModbusStoreConfig
from abbe.drivers.stores.modbus.registers import MemoryStatus
from abbe.drivers.stores.repeating import LOOK, Refusal, again, until_up

T = TypeVar("T")

_BUSY = (5, 6)
"""Exceptions of a device that asks for patience."""
_STAGED, _ACTIVE = 0, 1


class ModbusStore(Store):
    """A controller's table memory behind Modbus registers."""

    Config: ClassVar[type[StoreConfig]] = ModbusStoreConfig
    config: ModbusStoreConfig

    def __init__(self, name: str, config: StoreConfig) -> None:
        super().__init__(name, config)
        self.restart_needed = self.config.acts_after_restart
        self._bus: Bus | None = None
        self._token = secrets.randbelow(0xFFFF) + 1

    @property
    def owns(self) -> tuple[str, ...]:
        """The unit behind the server, or the serial port."""
        config = self.config
        if config.transport == "tcp":
            return (resources.modbus(str(config.host), int(config.port), config.unit_id),)
        return resources.serial(str(config.port))

    async def open(self) -> None:
        """Connect and get a first answer."""
        await self.close()
        self._bus = bus = Bus(self.name, self.config.link(), LinkStatus())
        await bus.reconnector.open()
        if not bus.reconnector.up:
            error = bus.reconnector.down_error()
            await self.close()
            raise error

    async def close(self) -> None:
        """Disconnect."""
        bus, self._bus = self._bus, None
        if bus is not None:
            await bus.reconnector.close()

    async def identity(self) -> Identity:
        """Name and serial number from the registers."""
        at = self.config.registers
        data = await self._steady(at.identity, at.name_words + at.serial_words)
        name, serial = data[: 2 * at.name_words], data[2 * at.name_words :]
        return Identity(registers.text_of(name), registers.text_of(serial))

    async def readiness(self) -> Readiness:
        """From the state word."""
        at = self.config.registers
        word = int.from_bytes(await self._steady(at.state, 1), "big")
        protected = at.protected_bit is not None and word >> at.protected_bit & 1
        return Readiness(
            bool(word >> at.idle_bit & 1),
            bool(word >> at.referenced_bit & 1),
            ("the controller's table memory is write-protected",) if protected else (),
        )

    async def active(self, progress: Progress = lambda _: None) -> Files:
        """The active image through the window, laid beside the controller's own checksum of it."""
        image = await self._area(_ACTIVE, progress)
        return unpack(image) if image else {}

    async def stage(self, files: Files, progress: Progress = lambda _: None) -> None:
        """Begin a staging area, fill it block by block, each checked."""
        image = pack(files)
        session = await self._command(registers.BEGIN, len(image), crc32(image))
        size = registers.block_bytes(self.config.registers.block_words)
        for sequence, offset in enumerate(range(0, len(image), size), start=1):
            content = image[offset : offset + size]
            await self._again(partial(self._block, session, sequence, offset, content))
            progress((offset + len(content)) / len(image))
        status = await self._status()
        if (status.staged_length, status.staged_crc) != (len(image), crc32(image)):
            raise LinkProtocolError(
                f"staged are {status.staged_length} bytes with CRC {status.staged_crc:08X}, "
                f"sent were {len(image)} with {crc32(image):08X}"
            )

    async def staged(self, progress: Progress = lambda _: None) -> Files:
        """The staging area through the window."""
        status = await self._status()
        if not status.session or not status.staged_length or not status.staged_crc:
            return {}
        return unpack(await self._area(_STAGED, progress))

    async def activate(self, files: Files) -> None:
        """Commit what is staged, if it has these files' length and checksum."""
        image = pack(files)
        await self._command(registers.COMMIT, len(image), crc32(image))

    async def discard(self) -> None:
        """Empty the staging area, and see that it is."""
        await self._again(lambda: self._command(registers.DISCARD))
        if (await self._status()).staged_length:
            raise LinkProtocolError("the staging area is not empty after it was discarded")

    async def deactivate(self) -> None:
        """Have no table active."""
        await self._command(registers.DEACTIVATE)

    async def effects(self) -> Sequence[ShownCorrection]:
        """Positions and corrections of one moment."""
        at = self.config.registers
        if at.shown is None:
            return ()
        place, count = at.shown, registers.shown_words(at.axes)

        async def look() -> ShownCorrection:
            return registers.shown(await self._read(place, count))

        return (await self._again(look),)

    # pieces

    async def _status(self) -> MemoryStatus:
        at = self.config.registers.status
        return registers.status_of(await self._steady(at, registers.STATUS_WORDS))

    async def _command(self, what: int, length: int = 0, crc: int = 0) -> int:
        """Give a command once and wait for its result; hands back its token."""
        token = self._token = self._token % 0xFFFF + 1
        lost: LinkError | None = None
        try:
            await self._write(
                self.config.registers.command, registers.command(token, what, length, crc)
            )
        except ModbusRefusedError as error:
            raise RefusedError(f"{self.name}: {error}") from error
        except LinkError as error:
            lost = error  # it may have been done all the same
        until = time.monotonic() + (self.config.timeout if lost else self.config.command_timeout)
        while True:
            status = await self._status()
            if status.token == token and status.result:
                break
            if time.monotonic() > until:
                raise lost or LinkTimeoutError(f"{self.name}: a command is not finished")
            await asyncio.sleep(LOOK)
        if status.result != registers.DONE:
            why = registers.RESULTS.get(status.result, f"result {status.result}")
            raise RefusedError(f"{self.name} refuses: {why}")
        return token

    async def _block(self, session: int, sequence: int, offset: int, content: bytes) -> None:
        """Write one block and see that it is stored."""
        await self._write(
            self.config.registers.block, registers.block(session, sequence, offset, content)
        )
        at = self.config.registers.status
        status = registers.status_of(await self._read(at, registers.STATUS_WORDS))
        found = (status.session, status.sequence, status.offset, status.block_crc)
        if found != (session, sequence, offset, crc32(content)):
            raise LinkProtocolError(f"block {sequence} from byte {offset} was not stored as sent")

    async def _area(self, area: int, progress: Progress) -> bytes:
        """All of an area; it has to have the length and checksum that the status tells."""
        for _ in range(self.config.attempts):
            status = await self._status()
            length, crc = (
                (status.active_length, status.active_crc)
                if area
                else (status.staged_length, status.staged_crc)
            )
            image = b""
            while len(image) < length:
                image += await self._again(partial(self._window, area, len(image)))
                progress(min(1.0, len(image) / length))
            if len(image) == length and (not length or crc32(image) == crc):
                return image
        raise LinkProtocolError(
            f"read were {len(image)} bytes with CRC {crc32(image):08X}, the controller's own "
            f"checksum says {length} bytes with {crc:08X}"
        )

    async def _window(self, area: int, offset: int) -> bytes:
        at = self.config.registers
        await self._write(at.pointer, registers.pointer(area, offset))
        content = registers.window(await self._read(at.window, at.window_words), area, offset)
        if not content:
            raise LinkProtocolError(f"the window is empty from byte {offset}")
        return content

    async def _steady(self, address: int, count: int) -> bytes:
        """Registers that two readings in a row agree on."""

        async def twice() -> bytes:
            one, other = await self._read(address, count), await self._read(address, count)
            if one != other:
                raise LinkProtocolError(f"two readings of registers {address} differ")
            return one

        return await self._again(twice)

    async def _again(self, do: Callable[[], Awaitable[T]]) -> T:
        return await again(do, self.config.attempts, self._refusal, self._until_up)

    def _refusal(self, error: LinkError) -> Refusal | None:
        if not isinstance(error, ModbusRefusedError):
            return None
        return Refusal(f"{self.name}: {error}", error.code not in _BUSY)

    async def _until_up(self, _: LinkError) -> None:
        reconnector = self._connected().reconnector
        await until_up(lambda: reconnector.up, self.config.reconnect_within, reconnector.down_error)

    def _connected(self) -> Bus:
        if self._bus is None:
            raise LinkDownError(f"{self.name} is not open")
        return self._bus

    async def _read(self, address: int, count: int) -> bytes:
        bus = self._connected()
        async with bus.bus_lock:
            return await bus.read(Span(self.config.unit_id, "holding", address, count))

    async def _write(self, address: int, words: Sequence[int]) -> None:
        bus = self._connected()
        async with bus.bus_lock:
            await bus.write(Span(self.config.unit_id, "holding", address, len(words)), words)
