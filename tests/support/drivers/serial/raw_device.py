"""A device's end of a serial line as the tests want it: answers when told to, remembers all."""

from __future__ import annotations

import asyncio
import os
import pty
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Answer = Callable[[str], list[tuple[float, str]]]
"""From a line that came: seconds to wait before each line of the answer, and that line."""


class RawDevice:
    """A pseudo-terminal served by a thread, so that it goes on while the event loop stands still.

    Attributes
    ----------
    path
        The port.
    lines
        What came, line by line, each with the time at which it did (monotonic, s).
    """

    def __init__(self, answer: Answer) -> None:
        self._answer = answer
        self.master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self.lines: list[tuple[float, str]] = []
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def send(self, text: str) -> None:
        """Send what nobody asked for."""
        data = text.encode("latin-1")
        while data:
            data = data[os.write(self.master, data) :]

    def send_count(self, number: int) -> None:
        """Send a counted line: X+1, X+2, …"""
        self.send(f"X{number:+d}\r\n")

    def got(self, text: str) -> list[float]:
        """When a line came."""
        return [at for at, line in self.lines if line == text]

    def close(self) -> None:
        """Hang up."""
        self._ended.set()
        os.close(self._slave)
        self._thread.join()
        os.close(self.master)

    def _serve(self) -> None:
        held = b""
        while not self._ended.is_set():
            try:
                held += os.read(self.master, 4096)
            except OSError:
                return  # hung up
            *lines, held = held.split(b"\r\n")
            for line in lines:
                text = line.decode("latin-1")
                self.lines.append((time.monotonic(), text))
                for wait, said in self._answer(text):
                    if wait:
                        self._ended.wait(wait)
                    self.send(said)


@contextmanager
def raw_device(answer: Answer = lambda _: []) -> Iterator[RawDevice]:
    device = RawDevice(answer)
    try:
        yield device
    finally:
        device.close()


def stand_still(seconds: float) -> None:
    """Hold the event loop up, as a computer does that is busy with something else."""
    assert asyncio.get_running_loop().is_running()
    time.sleep(seconds)
