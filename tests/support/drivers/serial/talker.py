"""A device that speaks unasked, from a thread, while the event loop may stand still."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any


class Talker:
    """Sends a counted message again and again, and remembers when each began to leave.

    Attributes
    ----------
    began
        Number in the message → monotonic s just before it was sent.
    """

    def __init__(self, send: Callable[[int], Any], period: float) -> None:
        self.began: dict[int, float] = {}
        self._send, self._period = send, period
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._talk, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Fall silent."""
        self._ended.set()
        self._thread.join()

    def _talk(self) -> None:
        number = 0
        while not self._ended.wait(self._period):
            number += 1
            self.began[number] = time.monotonic()
            self._send(number)
