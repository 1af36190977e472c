"""The person at the keyboard: Enter when an instrument is set up, s to leave a set-up out."""

from __future__ import annotations

import asyncio
import os
import sys

ENTER, LEAVE_OUT = "enter", "leave out"


class Person:
    """What was typed, line by line.

    Parameters
    ----------
    there
        Whether there is somebody; else every set-up counts as set up when the machine comes to it.
    """

    def __init__(self, *, there: bool) -> None:
        self.there = there
        self._held = b""
        self._typed: list[str] = []

    def begin(self) -> None:
        """Listen, in the running event loop."""
        if self.there:
            asyncio.get_running_loop().add_reader(sys.stdin.fileno(), self._read)

    def end(self) -> None:
        """Listen no more."""
        if self.there:
            asyncio.get_running_loop().remove_reader(sys.stdin.fileno())

    def answer(self) -> str:
        """What was typed since it was asked last: `ENTER`, `LEAVE_OUT`, or empty."""
        return self._typed.pop(0) if self._typed else ""

    def forget(self) -> None:
        """What was typed before now answers nothing."""
        self._typed.clear()

    def _read(self) -> None:
        data = os.read(sys.stdin.fileno(), 4096)
        if not data:
            self.end()
            self.there = False
            return
        *lines, self._held = (self._held + data).split(b"\n")
        for line in lines:
            word = line.strip().lower()
            self._typed.append(LEAVE_OUT if word in (b"s", b"skip") else ENTER)


def somebody_there() -> bool:
    """Whether somebody sits at a terminal and can be asked."""
    return sys.stdin is not None and sys.stdin.isatty()
