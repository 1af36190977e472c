"""One end of a serial line: a raw pseudo-terminal that can be unplugged; how late those are."""

from __future__ import annotations

import contextlib
import os
import pty
import time
import tty
from collections.abc import Callable
from pathlib import Path

from abbe.drivers.simulated.torment.judge.evidence import WireLog
from abbe.drivers.simulated.torment.loop import Loop, Moment


class PtyEnd:
    """The device's end; the other is at `path`, a symbolic link that outlives unplugging.

    Parameters
    ----------
    loop, log
        Of the trial.
    path
        What Abbe opens.
    on_data
        Called when `held` has grown.

    Attributes
    ----------
    held
        What came and was not taken out yet.
    """

    def __init__(
        self, loop: Loop, log: WireLog, path: Path, on_data: Callable[[Moment], None]
    ) -> None:
        self._loop = loop
        self._log = log
        self._on_data = on_data
        self._fds: tuple[int, int] | None = None
        self._early = 0.0
        self.path = path
        self.held = b""

    def plug(self) -> None:
        """Make it appear; safe to call twice."""
        if self._fds is not None:
            return
        master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self._fds = (master, slave)  # the far end stays open here, so that clients may come and go
        self.held = b""
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(slave))
        self._loop.watch(master, self._readable)

    def unplug(self) -> None:
        """Make it vanish; safe to call twice."""
        if self._fds is None:
            return
        fds, self._fds = self._fds, None
        self._loop.forget(fds[0])
        self.path.unlink(missing_ok=True)
        for fd in fds:
            os.close(fd)

    def send(self, data: bytes) -> bool:
        """Send all of it; False when it is unplugged or nobody reads."""
        if self._fds is None:
            return False
        try:
            return os.write(self._fds[0], data) == len(data)
        except OSError:
            return False

    def _readable(self, moment: Moment) -> None:
        if self._fds is None:
            return
        with contextlib.suppress(OSError):
            data = os.read(self._fds[0], 65536)
            self._log.say("<", data)
            if not self.held:
                self._early = moment.early
            self.held += data
            self._on_data(Moment(self._early, moment.late))


class PtyProbe:
    """Sends bytes to itself: on a busy computer the kernel's own part of a pseudo-terminal is late.

    Parameters
    ----------
    loop
        Gets the delays.
    every
        s between two bytes.
    """

    def __init__(self, loop: Loop, every: float = 0.02) -> None:
        self._loop = loop
        self._every = every
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._sent = 0.0
        self._closed = False
        loop.watch(self._master, self._readable)
        self._send()

    def close(self) -> None:
        """End it."""
        self._closed = True
        self._loop.forget(self._master)
        os.close(self._master)
        os.close(self._slave)

    def _send(self) -> None:
        if not self._closed:
            self._sent = self._loop.expected = time.monotonic()
            os.write(self._slave, b".")

    def _readable(self, moment: Moment) -> None:
        os.read(self._master, 64)
        self._loop.delays.append((moment.late, moment.late - self._sent))
        self._loop.expected = float("inf")
        self._loop.after(self._every, self._send)
