"""Two pseudo-terminals joined back to back: a serial cable without hardware."""

from __future__ import annotations

import asyncio
import contextlib
import os
import pty
import tty


class PtyPair:
    """What is written to one end comes out of the other.

    Attributes
    ----------
    near, far
        Paths of both ends, to be opened as serial ports (8N1; the baud rate is not paced).
    """

    def __init__(self) -> None:
        self._fds: list[int] = []
        masters, names = [], []
        for _ in range(2):
            master, slave = pty.openpty()
            tty.setraw(master)
            os.set_blocking(master, False)
            masters.append(master)
            names.append(os.ttyname(slave))
            # The slaves stay open here, so that a client may come and go without a hang-up.
            self._fds += [master, slave]
        self._masters = (masters[0], masters[1])
        self.near, self.far = names

    def start(self) -> None:
        """Join the ends on the running event loop."""
        loop = asyncio.get_running_loop()
        one, other = self._masters
        loop.add_reader(one, self._pump, one, other)
        loop.add_reader(other, self._pump, other, one)

    def close(self) -> None:
        """Cut the cable; safe to call twice."""
        loop = asyncio.get_running_loop()
        for master in self._masters:
            loop.remove_reader(master)
        for fd in self._fds:
            os.close(fd)
        self._fds = []

    @staticmethod
    def _pump(source: int, sink: int) -> None:
        with contextlib.suppress(BlockingIOError):
            data = os.read(source, 4096)
            # A full far end loses bytes, as a real receiver without flow control does.
            os.write(sink, data)
