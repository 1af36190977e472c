"""What a command takes from the start of its process to its end: seconds and memory."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

ENVIRONMENT = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
"""As on a user's machine, where Python keeps compiled files from one start to the next."""


@dataclass(frozen=True)
class Used:
    """What a process took: s on the wall, s of the processor, greatest memory in MB."""

    wall: float
    cpu: float
    memory: float

    @classmethod
    def by(cls, *command: str, folder: Path) -> Used:
        """Run a command to its end, quietly."""
        start = time.perf_counter()
        process = os.fork()
        if process == 0:
            os.chdir(folder)
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 1)
            os.dup2(nowhere, 2)
            os.execve(command[0], command, ENVIRONMENT)
        _, status, usage = os.wait4(process, 0)
        if status:
            raise SystemExit(f"{' '.join(command)} ended with status {status}")
        wall = time.perf_counter() - start
        return cls(wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0)

    @classmethod
    def least(cls, turns: int, *command: str, folder: Path) -> Used:
        """The least of several turns, each figure by itself: others share the machine."""
        many = [cls.by(*command, folder=folder) for _ in range(turns)]
        return cls(*(min(getattr(u, f) for u in many) for f in ("wall", "cpu", "memory")))
