"""The process of an HTTP interface's clients, as a soak or a benchmark has it ask and rest."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from pathlib import Path
from typing import IO

from abbe.drivers.simulated.soak.http_clients import ClientCounts


class HttpClients:
    """Twenty clients that read, five that never do, one that sends rubbish.

    They begin with `go`. A process of their own keeps them from delaying who judges or measures.

    Parameters
    ----------
    path
        The interface's Unix socket.
    every
        s between two cycles of the fastest streams; 0: every one.
    port, token
        Where else it listens on this computer, and what it takes there; 0: nowhere.
    """

    def __init__(self, path: Path, every: float, port: int = 0, token: str = "") -> None:
        network = [str(port), token] if port else []
        self._process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "abbe.drivers.simulated.soak.http_clients",
                str(path),
                str(every),
                *network,
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )

    def go(self) -> None:
        """Have them ask; returns at once."""
        self._say("go")

    def rest(self) -> ClientCounts:
        """Have them close everything; what they have met so far."""
        hearing = self._say("rest")
        return ClientCounts(**json.loads(hearing.readline()))

    def close(self) -> None:
        """End them."""
        with contextlib.suppress(OSError):
            self._process.communicate(timeout=20.0)
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()

    def _say(self, word: str) -> IO[bytes]:
        sending, hearing = self._process.stdin, self._process.stdout
        if sending is None or hearing is None:
            raise RuntimeError("no pipe")
        sending.write(word.encode() + b"\n")
        sending.flush()
        return hearing
