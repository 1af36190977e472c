"""The LinuxCNC that runs with an INI file, if one does, and since when."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import NamedTuple

_PROC = Path("/proc")
_BOOT = Path("/proc/sys/kernel/random/boot_id")
_START_FIELD = 19
"""Of /proc/PID/stat after the name in brackets: starttime, clock ticks since boot (proc(5))."""


class Task(NamedTuple):
    """LinuxCNC's task process, which reads the INI file and the compensation files when it starts.

    Attributes
    ----------
    pid
        Its number.
    started
        s since the computer was switched on.
    """

    pid: int
    started: float


def find_task(name: str, ini: Path) -> Task | None:
    """The task process of an INI file; None where there is none.

    Parameters
    ----------
    name
        ``[TASK] TASK``.
    ini
        The INI file.
    """
    for entry in _PROC.glob("[0-9]*"):
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0")
            if not words or Path(os.fsdecode(words[0])).name != Path(name).name:
                continue
            stated = os.fsdecode(words[words.index(b"-ini") + 1])
            if (entry / "cwd" / stated).resolve() == ini.resolve():
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                ticks = int(fields[_START_FIELD])
                return Task(int(entry.name), ticks / os.sysconf("SC_CLK_TCK"))
        except (OSError, ValueError, IndexError):
            continue  # it ended meanwhile, is somebody else's, or is no task
    return None


def boot() -> str:
    """A name for the time since the computer was switched on."""
    return _BOOT.read_text().strip()


def since_boot() -> float:
    """Seconds since the computer was switched on, the clock of `Task.started`."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)
