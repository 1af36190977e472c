"""Tables over a serial line, as a tape: DC1/DC3, ``%`` framing, own pace, checked, resumable.

The receiver is in command: DC1 (XON) asks for characters, DC3 (XOFF) stops them. Drivers and
adapters hold hundreds of characters that nobody can call back when DC3 comes, and a control
allows some ten more (Fanuc B-63503EN). So DC1 and DC3 are obeyed here and not by the driver, and
never more is handed to the driver than the line can carry in the meantime: ``run_on`` characters
at a time, each lot given its time on the wire.

A tape is ``%``, blocks that each end with a line feed, ``%``. Three ways to know that it arrived:

``echo``
    The receiver sends each block back as it stored it; a block counts when its echo is right, and
    the next one is sent only then. After a break the tape goes on with the first block that does
    not count, as a new tape: for receivers that store block by block.
``checksum``
    After the closing ``%`` the receiver sends one line with the checksum of all between the two.
    After a break everything is sent again.
``none``
    Nobody knows; the caller has to read back. After a break everything is sent again.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from abbe.drivers.link import LinkDownError, LinkProtocolError
from abbe.drivers.serial.checksum import ALGORITHMS, shown
from abbe.drivers.serial.patterns import LinePattern
from abbe.drivers.serial.tape import CONTROL, TapeLine, TapeSettings, check_blocks


@dataclass(frozen=True, slots=True)
class TapeReport:
    """What a transfer was like.

    Attributes
    ----------
    blocks
        Blocks of the table.
    tapes
        Tapes that were begun; more than one after a break.
    seconds
        From the first character to the end.
    verified
        ``echo``, ``checksum``, or ``none``: then nobody knows what arrived.
    """

    blocks: int
    tapes: int
    seconds: float
    verified: str


class TapeMismatchError(LinkProtocolError):
    """The receiver stored something else than was sent.

    Attributes
    ----------
    block
        Number of the block from 0; None where only the whole is known to differ.
    """

    def __init__(self, message: str, block: int | None = None) -> None:
        super().__init__(message)
        self.block = block


async def send_tape(
    settings: TapeSettings,
    blocks: Sequence[str],
    first: int = 0,
    on_confirmed: Callable[[int], None] = lambda _: None,
    ask: bytes = b"",
) -> TapeReport:
    """Send a table.

    Parameters
    ----------
    settings
        Port and control.
    blocks
        Lines of the table, printable ASCII, without ends and without ``%``.
    first
        Block to begin with: what `on_confirmed` was called with last in an earlier, interrupted
        transfer.
    on_confirmed
        Called with the number of blocks that certainly arrived, each time it grows.
    ask
        What to send first to a control that is told over the line, not by its operator, to read.

    Raises
    ------
    LinkError
        When a block cannot be on a tape; nothing was sent.
    TapeMismatchError
        When the receiver stored something else.
    LinkTimeoutError
        When it does not ask for characters, stops for too long, or confirms nothing.
    LinkProtocolError
        When it says something else in between (an alarm).
    LinkDownError
        When the port is lost and not found again, or `attempts` are used up.
    """
    check_blocks(blocks)
    began = time.monotonic()
    tapes, confirmed = 0, first

    def confirm(count: int) -> None:
        nonlocal confirmed
        if count > confirmed:
            confirmed = count
            on_confirmed(count)

    while True:
        tapes += 1
        line = TapeLine(settings)
        try:
            await _open_again(line, settings, patient=tapes > 1)
            await _send_once(line, settings, blocks, confirmed, confirm, ask)
            break
        except LinkDownError as error:
            if not settings.resume_within or tapes >= settings.attempts:
                raise LinkDownError(
                    f"{error}; {confirmed} of {len(blocks)} blocks are confirmed"
                ) from error
        finally:
            await line.close()
    return TapeReport(len(blocks), tapes, time.monotonic() - began, settings.verify)


async def _open_again(line: TapeLine, settings: TapeSettings, *, patient: bool) -> None:
    """Open the port; after a break it may take a while to come back."""
    deadline = time.monotonic() + (settings.resume_within if patient else 0.0)
    pause = 0.05
    while True:
        try:
            await line.open()
            return
        except LinkDownError:
            if time.monotonic() + pause > deadline:
                raise
        await asyncio.sleep(pause)
        pause = min(2.0 * pause, 1.0)


async def _send_once(
    line: TapeLine,
    settings: TapeSettings,
    blocks: Sequence[str],
    first: int,
    confirm: Callable[[int], None],
    ask: bytes,
) -> None:
    """One tape: all blocks from `first` on."""
    if first >= len(blocks) > 0 and settings.verify == "echo":
        return
    end = settings.end_of_block.encode("ascii")
    blank = bytes(settings.leader)
    if ask:
        line.ask(ask)
    if settings.wait_for_dc1:
        await line.until_asked(settings.start_timeout)
    await line.send(blank + b"%" + end)
    for number in range(first, len(blocks)):
        data = blocks[number].encode("ascii")
        await line.send(data + end)
        if settings.verify == "echo":
            echo = await line.next_line(settings.stall_timeout, f"the echo of block {number}")
            if echo.strip() != data.strip():
                await line.send(b"%" + end)
                raise TapeMismatchError(
                    f"block {number}: sent {shown(data)}, the receiver stored {shown(echo)}",
                    number,
                )
            confirm(number + 1)
        else:
            line.refuse_lines(f"while block {number} was sent")
    await line.send(b"%" + end + blank)
    await line.until_sent()
    if settings.verify == "checksum":
        await _compare_checksum(line, settings, blocks)
    elif settings.verify == "none":
        line.refuse_lines("after the tape")
    confirm(len(blocks))


async def _compare_checksum(line: TapeLine, settings: TapeSettings, blocks: Sequence[str]) -> None:
    end = settings.end_of_block
    sent = (end + "".join(block + end for block in blocks)).encode("ascii")
    computed = ALGORITHMS[settings.checksum](sent)
    reply = await line.next_line(settings.stall_timeout, "the checksum")
    found = LinePattern(settings.checksum_reply).fullmatch(reply.decode("latin-1").strip())
    if found is None:
        raise LinkProtocolError(f"{shown(reply)} came in place of the checksum")
    if int(found["checksum"], 16) != computed:
        raise TapeMismatchError(
            f"the receiver's checksum is {found['checksum']}, of what was sent {computed:04X}"
        )


async def receive_tape(settings: TapeSettings, ask: bytes = b"") -> list[str]:
    """Take in a tape that a control sends (its operator presses PUNCH, or it is asked).

    Parameters
    ----------
    settings
        Port and control; `start_timeout` is the longest wait for the first ``%``, `stall_timeout`
        the longest pause between two characters.
    ask
        What to send first to a control that is told over the line to send.

    Returns
    -------
    The blocks between the two ``%``, without their ends; empty ones left out.

    Raises
    ------
    LinkTimeoutError
        When no tape begins, or it stops before its closing ``%``.
    LinkDownError
        When the port is lost.
    """
    line = TapeLine(settings)
    try:
        await line.open()
        if ask:
            line.ask(ask)
        await line.until_character(b"%", settings.start_timeout, "the beginning of a tape")
        tape = await line.until_character(b"%", settings.stall_timeout, "the end of the tape")
    finally:
        await line.close()
    text = bytes(byte for byte in tape if byte not in CONTROL).decode("latin-1")
    blocks = (block.strip() for block in text.replace("\r", "\n").split("\n"))
    return [block for block in blocks if block]


__all__ = [
    "TapeMismatchError",
    "TapeReport",
    "TapeSettings",
    "receive_tape",
    "send_tape",
]
