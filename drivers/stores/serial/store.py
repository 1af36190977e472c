r"""Tables over a serial line: commands in ASCII, the tables themselves as tapes both ways.

A control that can be told over the line to read and to punch a tape. What is said is configuration
(`config.Texts`); every line carries a checksum, what is only read is read twice, and a tape's
blocks carry numbers and checksums of their own (`tape_image`). DC1 and DC3 are obeyed as in
`abbe.drivers.serial.transfer`.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Callable, Sequence
from typing import ClassVar, TypeVar

from abbe.drivers import resources
from abbe.drivers.link import LinkDownError, LinkError, LinkProtocolError, LinkTimeoutError
from abbe.drivers.serial.conversation import Conversation
from abbe.drivers.serial.patterns import Match
from abbe.drivers.serial.question import DeviceRefusedError as LineRefusedError
from abbe.drivers.serial.question import SerialQuestion, framed
from abbe.drivers.serial.transfer import receive_tape, send_tape
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
from abbe.drivers.stores.repeating import Refusal, again
from abbe.drivers.stores.serial.config import MEMORY, SerialStoreConfig
from abbe.drivers.stores.serial.tape_image import from_blocks, to_blocks

T = TypeVar("T")

_NUMBER = r"[-+]?\d+(?:\.\d+)?"


class SerialStore(Store):
    """A control's table memory behind a serial line."""

    Config: ClassVar[type[StoreConfig]] = SerialStoreConfig
    config: SerialStoreConfig

    def __init__(self, name: str, config: StoreConfig) -> None:
        super().__init__(name, config)
        texts = self.config.texts
        self._questions = {
            key: SerialQuestion(
                f"{name} {key}", getattr(texts, f"{key}_answer"), 1, self.config.checksum,
                texts.refused,
            )
            for key in ("identity", "state", "memory", "activate", "discard", "deactivate", "shown")
        }  # fmt: skip
        self._talk: Conversation | None = None

    @property
    def owns(self) -> tuple[str, ...]:
        """The port."""
        return resources.serial(self.config.port)

    async def open(self) -> None:
        """Open the port and have the control say who it is."""
        await self._listen()
        try:
            await self.identity()
        except BaseException:
            await self.close()
            raise

    async def close(self) -> None:
        """Free the port."""
        talk, self._talk = self._talk, None
        if talk is not None:
            await talk.close()

    async def identity(self) -> Identity:
        """As the control says."""
        found = await self._steady("identity", self.config.texts.identity)
        return Identity(found["name"].strip(), found["serial"].strip())

    async def readiness(self) -> Readiness:
        """As the control says."""
        found = await self._steady("state", self.config.texts.state)
        protected = found["protected"] == "1"
        return Readiness(
            found["idle"] == "1",
            found["referenced"] == "1",
            ("the controller's table memory is write-protected",) if protected else (),
        )

    async def active(self, progress: Progress = lambda _: None) -> Files:
        """The tape of what is active, laid beside the control's own checksum of it."""
        return await self._tape_of(self.config.texts.send_active, "active", progress)

    async def stage(self, files: Files, progress: Progress = lambda _: None) -> None:
        """Have the control read a tape into its staging area."""
        image = pack(files)
        blocks = to_blocks(image)
        ask = self._framed(self.config.texts.receive, image)
        await self.close()
        try:
            await send_tape(self.config.tape(), blocks, ask=ask)
        finally:
            await self._listen()
        progress(1.0)
        found = await self._memory()
        if (found["staged_length"], found["staged_crc"]) != (len(image), crc32(image)):
            raise LinkProtocolError(
                f"staged are {found['staged_length']} bytes with CRC {found['staged_crc']:08X}, "
                f"sent were {len(image)} with {crc32(image):08X}"
            )

    async def staged(self, progress: Progress = lambda _: None) -> Files:
        """The tape of what is staged."""
        found = await self._memory()
        if not found["staged_length"] or not found["staged_crc"]:
            return {}
        return await self._tape_of(self.config.texts.send_staged, "staged", progress)

    async def activate(self, files: Files) -> None:
        """Have what is staged become active, if it has these files' length and checksum."""
        await self._command("activate", self._framed(self.config.texts.activate, pack(files)))

    async def discard(self) -> None:
        """Empty the staging area, and see that it is."""
        data = self._framed(self.config.texts.discard)
        await self._again(lambda: self._command("discard", data))
        if (await self._memory())["staged_length"]:
            raise LinkProtocolError("the staging area is not empty after it was discarded")

    async def deactivate(self) -> None:
        """Have no table active."""
        await self._command("deactivate", self._framed(self.config.texts.deactivate))

    async def effects(self) -> Sequence[ShownCorrection]:
        """Positions and corrections of one moment."""
        query = self.config.texts.shown
        if query is None:
            return ()
        data = self._framed(query)
        found = await self._again(lambda: self._ask("shown", data))
        return (_effect(found["shown"]),)

    # pieces

    def _framed(self, text: str, image: bytes = b"") -> bytes:
        said = text.format(length=len(image), crc=crc32(image))
        return framed(self.config.line(), said, self.config.checksum)

    async def _listen(self) -> None:
        """Open the port for questions; what a cut-off transfer left is ended."""
        await self.close()
        talk = Conversation(self.config.line(), tuple(self._questions.values()), lambda _: None)
        self._talk = talk
        await talk.open()
        if self.config.texts.abort:
            talk.tell(self.config.texts.abort.encode("ascii"))

    async def _ask(self, key: str, data: bytes) -> Match:
        if self._talk is None:
            raise LinkDownError(f"{self.name}: the port is not open")
        return await self._talk.ask(self._questions[key], data)

    async def _command(self, key: str, data: bytes) -> None:
        """Give a command once; what became of it is read elsewhere."""
        try:
            await self._ask(key, data)
        except LineRefusedError as error:
            raise RefusedError(str(error)) from error

    async def _steady(self, key: str, text: str) -> dict[str, str]:
        """An answer that comes twice in a row."""
        data = self._framed(text)

        async def twice() -> dict[str, str]:
            one, other = await self._ask(key, data), await self._ask(key, data)
            if one.groupdict() != other.groupdict():
                raise LinkProtocolError(f"{self.name}: two answers to {text!r} differ")
            return one.groupdict()

        return await self._again(twice)

    async def _memory(self) -> dict[str, int]:
        found = await self._steady("memory", self.config.texts.memory)
        return {name: int(found[name], 16 if name.endswith("crc") else 10) for name in MEMORY}

    async def _tape_of(self, text: str, what: str, progress: Progress) -> Files:
        """A tape from the control; it has to have the length and checksum that are stated."""
        ask = self._framed(text)

        async def once() -> Files:
            found = await self._memory()
            length, crc = found[f"{what}_length"], found[f"{what}_crc"]
            if not length:
                return {}
            await self.close()
            try:
                blocks = await receive_tape(self.config.tape(), ask)
            finally:
                await self._listen()
            image = from_blocks(blocks)
            if (len(image), crc32(image)) != (length, crc):
                raise LinkProtocolError(
                    f"{self.name}: read were {len(image)} bytes with CRC {crc32(image):08X}, the "
                    f"controller's own checksum says {length} bytes with {crc:08X}"
                )
            progress(1.0)
            return unpack(image)

        return await self._again(once)

    async def _again(self, do: Callable[[], Awaitable[T]]) -> T:
        return await again(do, self.config.attempts, self._refusal, self._recover)

    def _refusal(self, error: LinkError) -> Refusal | None:
        return Refusal(str(error), for_good=True) if isinstance(error, LineRefusedError) else None

    async def _recover(self, error: LinkError) -> None:
        if isinstance(error, (LinkDownError, LinkTimeoutError)):
            # until no late answer can pass for the next one
            await asyncio.sleep(self.config.late_reply_max)
        if isinstance(error, LinkDownError):
            await self._find_again()

    async def _find_again(self) -> None:
        """Open a port that was lost, if it is back; the next question says when it is not."""
        try:
            await self._listen()
        except LinkDownError:
            await self.close()


def _effect(text: str) -> ShownCorrection:
    """``X,1,123.4,-0.0012;Y,…`` as an effect.

    Raises
    ------
    LinkProtocolError
        When it is not that.
    """
    position, direction, correction = {}, {}, {}
    for part in text.split(";"):
        match = re.fullmatch(rf"([A-Z]\d?),(-?[01]),({_NUMBER}),({_NUMBER})", part.strip())
        if match is None:
            raise LinkProtocolError(f"{part!r} is not axis, direction, position, correction")
        position[match[1]], correction[match[1]] = float(match[3]), float(match[4])
        direction[match[1]] = int(match[2])
    return ShownCorrection(position, correction, direction)
