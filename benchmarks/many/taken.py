"""What processes take, part by part: memory that is theirs, and processor seconds."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

PARTS: Mapping[str, str] = {
    "abbe.daemon.http.process": "HTTP",
    "abbe.daemon.mqtt.process": "MQTT",
    "abbe.daemon.fleet.uploading.process": "store's upload",
    "abbe.daemon run": "run",
}
"""What a command line holds → the part of Abbe that it is."""


@dataclass(frozen=True)
class ProcessTaken:
    """What one process has taken so far.

    Attributes
    ----------
    memory
        MB; what it shares with others is divided among them (Linux: PSS).
    processor
        s.
    """

    memory: float
    processor: float


def below(roots: Iterable[int]) -> list[int]:
    """Processes and all that they have begun."""
    children = defaultdict(list)
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            after = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        children[int(after[1])].append(int(folder.name))
    found, left = [], list(roots)
    while left:
        found.append(left.pop())
        left += children[found[-1]]
    return found


def taken(process: int) -> ProcessTaken:
    """What a process takes now; nothing where it is gone."""
    folder = Path("/proc") / str(process)
    try:
        lines = (folder / "smaps_rollup").read_text().splitlines()
        after = (folder / "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ProcessTaken(0.0, 0.0)
    own = next((float(line.split()[1]) for line in lines if line.startswith("Pss:")), 0.0)
    ticks = int(after[11]) + int(after[12])
    return ProcessTaken(own / 1024.0, ticks / os.sysconf("SC_CLK_TCK"))


def parts_of(roots: Iterable[int]) -> dict[str, list[int]]:
    """Part of Abbe → its processes, of some runs."""
    found: dict[str, list[int]] = {name: [] for name in PARTS.values()}
    for process in below(roots):
        try:
            words = (Path("/proc") / str(process) / "cmdline").read_bytes().replace(b"\0", b" ")
        except OSError:
            continue
        for pattern, part in PARTS.items():
            if pattern.encode() in words:
                found[part].append(process)
                break
    return found
