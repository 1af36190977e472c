"""Tables in a CANopen node: an image into a staging DOMAIN by SDO block transfer, one commit.

SDO's own CRC-16 guards a block transfer, and nothing guards a segmented one or a short object on a
serial adapter's line. So every image has to have the length and CRC-32 that the node tells, and
short objects are read until two readings agree. `abbe.drivers.stores.canopen.objects` is the map.
"""

from __future__ import annotations

import asyncio
import struct
import time
from collections.abc import Awaitable, Callable, Sequence
from typing import ClassVar, TypeVar

from abbe.drivers import resources
from abbe.drivers.can.canopen.bus import NodeBus
from abbe.drivers.can.canopen.sdo.adapter import Network
from abbe.drivers.can.canopen.sdo.errors import SdoAbortError as SdoRefusedError
from abbe.drivers.link import (
    LinkDownError,
    LinkError,
    LinkProtocolError,
    LinkStatus,
    LinkTimeoutError,
)
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
from abbe.drivers.stores.canopen.config import NODE, CanopenStoreConfig
from abbe.drivers.stores.canopen.objects import Object, number, shown, shown_objects
from abbe.drivers.stores.image import crc32, pack, unpack
from abbe.drivers.stores.repeating import LOOK, Refusal, again, until_up

T = TypeVar("T")


class CanopenStore(Store):
    """A controller's table memory behind a CANopen object dictionary."""

    Config: ClassVar[type[StoreConfig]] = CanopenStoreConfig
    config: CanopenStoreConfig

    def __init__(self, name: str, config: CanopenStoreConfig) -> None:
        super().__init__(name, config)
        self.adds_error = config.objects.adds_error
        self._bus: NodeBus | None = None

    @property
    def owns(self) -> tuple[str, ...]:
        """The interface."""
        return resources.can(self.config.interface, self.config.channel)

    async def open(self) -> None:
        """Open the interface and get a first answer of the node."""
        await self.close()
        bus = NodeBus(self.name, self.config.link(), LinkStatus())
        await bus.open()
        if not bus.reconnector.up:
            error = bus.reconnector.down_error()
            await bus.close()
            raise error
        self._bus = bus

    async def close(self) -> None:
        """Close the interface."""
        bus, self._bus = self._bus, None
        if bus is not None:
            await bus.close()

    async def identity(self) -> Identity:
        """Name and serial number from the objects."""
        at = self.config.objects
        name = (await self._steady([at.name]))[at.name]
        serial = number((await self._steady([at.serial]))[at.serial])
        text = name.rstrip(b"\0").decode("ascii", errors="replace").strip()
        return Identity(text, f"{serial:d}")

    async def readiness(self) -> Readiness:
        """From the state object."""
        at = self.config.objects
        word = number((await self._steady([at.state]))[at.state])
        protected = at.protected_bit is not None and word >> at.protected_bit & 1
        return Readiness(
            bool(word >> at.idle_bit & 1),
            bool(word >> at.referenced_bit & 1),
            ("the controller's table memory is write-protected",) if protected else (),
        )

    async def active(self, progress: Progress = lambda _: None) -> Files:
        """The active image, which has to have the length and CRC-32 that the node tells."""
        at = self.config.objects
        image = await self._image(at.active, at.active_length, at.active_crc, progress)
        return unpack(image) if image else {}

    async def stage(self, files: Files, progress: Progress = lambda _: None) -> None:
        """Empty the staging area, send the image, and see that the node has the same CRC-32."""
        image = pack(files)
        at = self.config.objects

        async def send() -> None:
            await self._write(at.discard, b"\x01")
            done = self._in_loop(progress, len(image))
            await self._transfer(
                lambda network: network.download_block(self.config.node, *at.staged, image, done)
            )
            length, crc = await self._summary(at.staged_length, at.staged_crc)
            if (length, crc) != (len(image), crc32(image)):
                raise LinkProtocolError(
                    f"staged are {length} bytes with CRC {crc:08X}, sent were {len(image)} with "
                    f"{crc32(image):08X}"
                )

        await self._again(send)
        progress(1.0)

    async def staged(self, progress: Progress = lambda _: None) -> Files:
        """The staging area, read back."""
        at = self.config.objects
        length, crc = await self._again(lambda: self._summary(at.staged_length, at.staged_crc))
        if not length or not crc:
            return {}
        return unpack(await self._image(at.staged, at.staged_length, at.staged_crc, progress))

    async def activate(self, files: Files) -> None:
        """Commit what is staged, if it has these files' checksum, and see that it is active."""
        image = pack(files)
        at = self.config.objects
        wanted = len(image), crc32(image)
        staged = await self._again(lambda: self._summary(at.staged_length, at.staged_crc))
        if staged != wanted:
            raise RefusedError(f"{self.name}: something else is staged; nothing was changed")
        await self._command(at.commit, struct.pack("<L", crc32(image)), wanted)

    async def discard(self) -> None:
        """Empty the staging area, and see that it is."""
        at = self.config.objects

        async def empty() -> None:
            await self._write(at.discard, b"\x01")
            length, crc = await self._summary(at.staged_length, at.staged_crc)
            if length and crc:
                raise LinkProtocolError("the staging area is not empty after it was discarded")

        await self._again(empty)

    async def deactivate(self) -> None:
        """Have no table active, and see that it is so."""
        await self._command(self.config.objects.deactivate, b"\x01", (0, None))

    async def effects(self) -> Sequence[ShownCorrection]:
        """Positions and corrections of one moment."""
        at = self.config.objects
        if not at.axes:
            return ()

        async def look() -> ShownCorrection:
            if at.hold is not None:
                await self._write(at.hold, b"\x01")
            objects = shown_objects(at)
            one, other = await self._read(objects), await self._read(objects)
            if one != other:
                raise LinkProtocolError("the machine moves: two readings of its positions differ")
            return shown(at, one)

        return (await self._again(look),)

    # pieces

    async def _image(
        self, place: Object, length_at: Object, crc_at: Object, progress: Progress
    ) -> bytes:
        async def read() -> bytes:
            length, crc = await self._summary(length_at, crc_at)
            if not length:
                return b""
            done = self._in_loop(progress, length)
            image = await self._transfer(
                lambda network: network.upload_block(self.config.node, *place, done)
            )
            if len(image) != length or crc32(image) != crc:
                raise LinkProtocolError(
                    f"read were {len(image)} bytes with CRC {crc32(image):08X}, the controller "
                    f"tells {length} bytes with {crc:08X}"
                )
            return image

        image = await self._again(read)
        progress(1.0)
        return image

    async def _summary(self, length_at: Object, crc_at: Object) -> tuple[int, int]:
        """Length and CRC-32 of an image, as two readings in a row tell them."""
        one, other = [await self._read([length_at, crc_at]) for _ in range(2)]
        if one != other:
            raise LinkProtocolError("two readings of an image's length and CRC differ")
        return number(one[length_at]), number(one[crc_at])

    async def _command(self, place: Object, data: bytes, wanted: tuple[int, int | None]) -> None:
        """Give a command once, and wait until what is active is as wanted."""
        at = self.config.objects
        lost: LinkError | None = None
        try:
            await self._write(place, data)
        except SdoRefusedError as error:
            raise RefusedError(f"{self.name}: {error}") from error
        except LinkError as error:
            lost = error  # it may have been done all the same
        limit = self.config.timeout if lost else self.config.command_timeout
        until = time.monotonic() + limit
        while True:
            found = await self._again(lambda: self._summary(at.active_length, at.active_crc))
            if found[0] == wanted[0] and wanted[1] in (None, found[1]):
                return
            if time.monotonic() > until:
                raise lost or LinkTimeoutError(
                    f"{self.name}: confirmed, and not done in {limit:g} s"
                )
            await asyncio.sleep(LOOK)

    async def _steady(self, objects: Sequence[Object]) -> dict[Object, bytes]:
        """Objects that two readings in a row agree on."""

        async def twice() -> dict[Object, bytes]:
            one, other = await self._read(objects), await self._read(objects)
            if one != other:
                raise LinkProtocolError(f"two readings of {objects[0][0]:04X}h differ")
            return one

        return await self._again(twice)

    async def _read(self, objects: Sequence[Object]) -> dict[Object, bytes]:
        node = self.config.node
        return {
            at: await self._transfer(lambda network, at=at: network.upload(node, *at))  # type: ignore[misc]
            for at in objects
        }

    async def _write(self, at: Object, data: bytes) -> None:
        await self._transfer(lambda network: network.download(self.config.node, *at, data))

    async def _transfer(self, job: Callable[[Network], T]) -> T:
        bus = self._connected()
        return await bus.transfer(bus.node(NODE), job)

    async def _again(self, do: Callable[[], Awaitable[T]]) -> T:
        return await again(do, self.config.attempts, self._refusal, self._until_up)

    def _refusal(self, error: LinkError) -> Refusal | None:
        # an abort may come from a transfer that was damaged on its way
        if not isinstance(error, SdoRefusedError):
            return None
        return Refusal(f"{self.name}: {error}", for_good=False)

    async def _until_up(self, _: LinkError) -> None:
        bus = self._connected()

        def down() -> LinkError:
            why = bus.node(NODE).why if bus.reconnector.up else ""
            return LinkTimeoutError(why) if why else bus.reconnector.down_error()

        await until_up(
            lambda: bus.reconnector.up and bus.node(NODE).prepared,
            self.config.reconnect_within,
            down,
        )

    def _connected(self) -> NodeBus:
        if self._bus is None:
            raise LinkDownError(f"{self.name} is not open")
        return self._bus

    @staticmethod
    def _in_loop(progress: Progress, whole: int) -> Callable[[int], None]:
        """Tell progress in the event loop, from a transfer's thread."""
        loop = asyncio.get_running_loop()

        def tell(count: int) -> None:
            loop.call_soon_threadsafe(progress, min(1.0, count / whole))

        return tell
