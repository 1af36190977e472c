"""How long Abbe's process waited for a processor, and the kernel was late: not Abbe's doing."""

from __future__ import annotations

import contextlib
from collections import deque
from pathlib import Path

from abbe.drivers.simulated.torment.loop import Loop


class ProcessorWaits:
    """How long one process has waited for a processor, noted now and then.

    Parameters
    ----------
    loop
        Knows how late bytes were that the kernel carried.

    Attributes
    ----------
    pid
        Of the process; None: there is none.
    """

    def __init__(self, loop: Loop) -> None:
        self._loop = loop
        self._noted: deque[tuple[float, float]] = deque(maxlen=3000)
        self._last = 0.0
        self.pid: int | None = None

    def begin(self, pid: int) -> None:
        """Another process, of which nothing is known."""
        self._noted.clear()
        self._last = 0.0
        self.pid = pid

    def note(self, now: float) -> None:
        """Take note, at a monotonic time (s)."""
        if not self._noted or now - self._noted[-1][0] > 0.01:
            self._noted.append((now, self._wait()))

    def between(self, early: float, late: float) -> float:
        """How long it waited between two monotonic times, and the kernel was late, s."""
        if not self._noted:
            return 0.0
        after = self._wait() + self._loop.delayed(early, late)
        before = self._noted[0][1]
        for when, wait in reversed(self._noted):
            if when <= early:
                before = wait
                break
        return after - before

    def _wait(self) -> float:
        """How long it has waited for a processor so far, s: Linux' scheduler knows.

        Of a process that has ended, as long as it was last known to.
        """
        if self.pid is None:
            return 0.0
        with contextlib.suppress(OSError, IndexError, ValueError):
            text = Path(f"/proc/{self.pid}/schedstat").read_text(encoding="ascii")
            self._last = max(self._last, int(text.split()[1]) * 1e-9)
        return self._last
