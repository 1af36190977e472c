"""A read-out between an instrument and its reader that is late, or shows another unit.

A gateway with a buffer: it asks the instrument all the time, and answers with what that said some
seconds ago. Its own pseudo-terminal, its own threads; it shares nothing with Abbe.
"""

from __future__ import annotations

import os
import pty
import random
import re
import termios
import threading
import time
import tty
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

_EVERY = 0.02
"""s between two questions."""


@dataclass
class BadReadOut:
    """One read-out.

    Attributes
    ----------
    source
        The instrument's own line.
    late
        s by which it is late.
    factor
        By which it multiplies what it shows.
    garbled
        Part of its answers that the line makes unreadable.
    silent
        Whether it answers nothing, as one that is switched off.
    port
        Where it is read.
    """

    source: str
    late: float = 0.0
    factor: float = 1.0
    garbled: float = 0.0
    silent: bool = False
    port: str = ""
    _said: deque[tuple[float, str]] = field(default_factory=deque)
    _chance: random.Random = field(default_factory=lambda: random.Random(1))
    _stop: threading.Event = field(default_factory=threading.Event)

    @contextmanager
    def served(self) -> Iterator[None]:
        """It answers while the context lasts."""
        master, slave = pty.openpty()
        tty.setraw(slave)
        self.port = os.ttyname(slave)
        threads = [
            threading.Thread(target=self._ask, daemon=True),
            threading.Thread(target=self._answer, args=(master,), daemon=True),
        ]
        for thread in threads:
            thread.start()
        try:
            yield
        finally:
            self._stop.set()
            for thread in threads:
                thread.join(5.0)
            os.close(master)
            os.close(slave)

    def _ask(self) -> None:
        line = os.open(self.source, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(line)
        settings = termios.tcgetattr(line)
        settings[6][termios.VMIN], settings[6][termios.VTIME] = 0, 5
        termios.tcsetattr(line, termios.TCSANOW, settings)
        begun = b""
        while not self._stop.is_set():
            os.write(line, b"R\r\n")
            begun += os.read(line, 400)
            *whole, begun = begun.split(b"\n")
            for answer in whole:
                self._said.append((time.monotonic(), answer.decode().strip()))
            time.sleep(_EVERY)
        os.close(line)

    def _answer(self, master: int) -> None:
        os.set_blocking(master, False)
        while not self._stop.is_set():
            try:
                asked = os.read(master, 400).count(b"R")
            except BlockingIOError:
                time.sleep(0.005)
                continue
            for _ in range(0 if self.silent else asked):
                shown = "\x7f~#" if self._chance.random() < self.garbled else self._shown()
                os.write(master, (shown + "\r\n").encode())

    def _shown(self) -> str:
        due = time.monotonic() - self.late
        while len(self._said) > 1 and self._said[1][0] <= due:
            self._said.popleft()
        said = self._said[0][1] if self._said else "BEAM"
        return re.sub(r"[-+]\d+\.\d+", lambda m: f"{float(m[0]) * self.factor:+015.7f}", said)
