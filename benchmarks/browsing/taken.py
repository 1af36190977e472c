"""Processor time and memory of a server and of a browser: the system's own figures (``/proc``)."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

_TICKS = os.sysconf("SC_CLK_TCK")


def resident(pid: int) -> float:
    """Resident memory of a process, MB."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return int(next(line.split()[1] for line in lines if line.startswith("VmRSS"))) / 1024.0


def spent(pid: int) -> float:
    """Processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


class BrowserProcesses:
    """All processes of the browsers that a process started.

    Parameters
    ----------
    of
        Its id; None: this one.
    """

    def __init__(self, of: int | None = None) -> None:
        below = _below(os.getpid() if of is None else of)
        self.pids = [pid for pid in below if _name(pid).startswith("chrom")]
        assert self.pids, "no browser was started"

    def spent(self) -> float:
        """Processor time so far, s."""
        return sum(spent(pid) for pid in self.pids)

    def memory(self) -> float:
        """Memory that is nobody else's, MB: without files that other programs have mapped, too."""
        return sum(_anonymous(pid) for pid in self.pids)

    def memory_of(self, kind: str) -> float:
        """The same of one kind of process: ``renderer`` draws the page."""
        return sum(_anonymous(pid) for pid in self.pids if f"--type={kind}" in _words(pid))


def _below(pid: int) -> Iterator[int]:
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text().split():
            yield int(child)
            yield from _below(int(child))


def _name(pid: int) -> str:
    return Path(f"/proc/{pid}/comm").read_text().strip()


def _words(pid: int) -> list[str]:
    # Chromium sets them apart by spaces
    return Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ").split()


def _anonymous(pid: int) -> float:
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return int(next(line.split()[1] for line in lines if line.startswith("Anonymous:"))) / 1024.0
