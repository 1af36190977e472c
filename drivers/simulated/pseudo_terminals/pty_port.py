"""A device's end of a serial line: a pseudo-terminal with its own pace that can be unplugged."""

from __future__ import annotations

import asyncio
import contextlib
import os
import pty
import tty
from collections.abc import Callable
from pathlib import Path

_MOST_UNREAD = 1 << 16
"""Bytes that wait for somebody to read them."""


class PtyPort:
    """One serial port of a simulated device.

    Parameters
    ----------
    link
        Where a symbolic link to the pseudo-terminal is kept while it is plugged in, as udev does
        under ``/dev/serial/by-id``; its path stays the same over unplugging.
    on_data
        Called with what the client sent.
    character_time
        s that one character takes on the line; 0: no pace, as fast as the machine.

    Attributes
    ----------
    plugged
        Whether the port is there.
    """

    def __init__(
        self, link: Path, on_data: Callable[[bytes], None], character_time: float = 0.0
    ) -> None:
        self.link = link
        self.plugged = False
        self._on_data = on_data
        self._character_time = character_time
        self._fds: tuple[int, int] = (-1, -1)
        self._outgoing = bytearray()
        self._sender: asyncio.Task[None] | None = None

    def plug(self) -> None:
        """Make the port appear; needs a running event loop."""
        if self.plugged:
            return
        master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        # The slave stays open here, so that a client may come and go without a hang-up.
        self._fds = (master, slave)
        self.plugged = True
        asyncio.get_running_loop().add_reader(master, self._readable)
        unfinished = self.link.with_name(self.link.name + ".new")
        unfinished.unlink(missing_ok=True)
        unfinished.symlink_to(os.ttyname(slave))
        unfinished.replace(self.link)

    def unplug(self) -> None:
        """Make it vanish: whoever has it open reads a hang-up. Safe to call twice."""
        if not self.plugged:
            return
        self.plugged = False
        if self._sender is not None:
            self._sender.cancel()
            self._sender = None
        self._outgoing.clear()
        asyncio.get_running_loop().remove_reader(self._fds[0])
        asyncio.get_running_loop().remove_writer(self._fds[0])
        self.link.unlink(missing_ok=True)
        for fd in self._fds:
            os.close(fd)

    def send(self, data: bytes) -> None:
        """Send, at the line's pace; what nobody reads for long is lost."""
        if not self.plugged or len(self._outgoing) > _MOST_UNREAD:
            return
        self._outgoing += data
        if not self._character_time:
            if len(self._outgoing) == len(data):
                self._send_some()
            return
        if self._sender is None or self._sender.done():
            self._sender = asyncio.get_running_loop().create_task(self._send_slowly())

    def _send_some(self) -> None:
        """Send what the driver takes, and the rest when it takes more."""
        loop, master = asyncio.get_running_loop(), self._fds[0]
        with contextlib.suppress(BlockingIOError):
            del self._outgoing[: os.write(master, self._outgoing)]
        if self._outgoing:
            loop.add_writer(master, self._send_some)
        else:
            loop.remove_writer(master)

    async def _send_slowly(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while self._outgoing:
            # Whatever the machine overslept is made up for, so that the pace holds on average.
            count = max(1, int((loop.time() - due) / self._character_time))
            piece = bytes(self._outgoing[:count])
            del self._outgoing[:count]
            due += len(piece) * self._character_time
            with contextlib.suppress(BlockingIOError):
                os.write(self._fds[0], piece)
            await asyncio.sleep(max(0.0, due - loop.time()))

    def _readable(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self._on_data(os.read(self._fds[0], 4096))
