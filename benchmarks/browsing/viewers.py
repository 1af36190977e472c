"""Many viewers: what they cost the server, and whether the run's cycle notices them."""

from __future__ import annotations

import http.client
import os
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.browsing.taken import resident, spent
from tests.support.daemon.live_run import Cycle, LiveRun, compensating, live_run, machine
from tests.support.daemon.workbench import OpenedWorkbench, opened

_SETTLED = 10.0
"""s after which figures are taken."""
_TURNS = 5
"""With viewers, and as many without, one after the other."""
_PERIOD_MS = 20.0
"""Of the machine's cycle."""


class Viewer(threading.Thread):
    """A browser that looks at the live view: counts the cycles that it gets."""

    def __init__(self, bench: OpenedWorkbench) -> None:
        super().__init__(daemon=True)
        self._bench = bench
        self.cycles = 0
        self.enough = False

    def run(self) -> None:
        """Read until it has seen enough, or the server ends."""
        connection = http.client.HTTPConnection("127.0.0.1", self._bench.port, timeout=60)
        asked = {"host": f"127.0.0.1:{self._bench.port}", "cookie": self._bench.cookie}
        connection.request("GET", "/api/live/stream", headers=asked)
        for line in connection.getresponse():
            self.cycles += line.startswith(b"event: cycle")
            if self.enough:
                break
        connection.close()


@contextmanager
def looking(bench: OpenedWorkbench, count: int) -> Iterator[list[Viewer]]:
    """So many viewers, each with its stream, until the block ends."""
    viewers = [Viewer(bench) for _ in range(count)]
    for viewer in viewers:
        viewer.start()
    try:
        yield viewers
    finally:
        for viewer in viewers:
            viewer.enough = True


@dataclass
class _Side:
    """What a run took in all turns with, or without viewers."""

    cpu: float = 0.0
    took: list[float] = field(default_factory=list)
    late: list[float] = field(default_factory=list)

    def turn(self, run: LiveRun, seconds: float) -> None:
        """Look at it for some seconds."""
        first, before = len(run.cycles), spent(run.process.pid)
        time.sleep(seconds)
        self.cpu += spent(run.process.pid) - before
        cycles: Sequence[Cycle] = run.cycles[first:]
        self.took += [c["cycle_ms"] for c in cycles]
        begun = 1e3 * np.diff([c["time"] for c in cycles])
        self.late += list(np.maximum(0.0, begun - _PERIOD_MS))

    def row(self, name: str) -> str:
        each = 1e3 * self.cpu / max(1, len(self.took))
        figures = (
            each,
            np.median(self.took),
            np.quantile(self.took, 0.99),
            np.median(self.late),
            np.quantile(self.late, 0.99),
        )
        return f"| {name} | {len(self.took)} | " + " | ".join(f"{x:.2f}" for x in figures) + " |"


def many_viewers(seconds: float, count: int = 20) -> str:
    """Measure; the figures as a page has them."""
    with tempfile.TemporaryDirectory() as name, machine(Path(name)) as (_, config):
        config.write_text(config.read_text() + "\n[records]\nevery = 0.1\n\n[http]\n")
        with opened(config) as bench, live_run(config) as run:
            run.until(compensating)
            bench.enter()
            bench.json("/api/live/volume")
            pid = bench.process.pid
            alone = resident(pid)
            with looking(bench, count) as viewers:
                time.sleep(_SETTLED)
                before, began, cpu = resident(pid), time.monotonic(), spent(pid)
                cycles = sum(v.cycles for v in viewers)
                time.sleep(seconds)
                passed = time.monotonic() - began
                each = (sum(v.cycles for v in viewers) - cycles) / count / passed
                used = (spent(pid) - cpu) / passed
                after = resident(pid)
            without, beside = _Side(), _Side()
            for _ in range(_TURNS):
                time.sleep(1.0)
                without.turn(run, 0.2 * seconds)
                with looking(bench, count):
                    time.sleep(1.0)
                    beside.turn(run, 0.2 * seconds)
            share = (beside.cpu / len(beside.took)) / (without.cpu / len(without.took))
    return f"""### Twenty viewers

A simulated machine corrected with records and HTTP, its live view streamed to {count} viewers at a
time for {passed:.0f} s; load of the host {os.getloadavg()[0]:.1f}.

| | |
| --- | --- |
| memory of the server, alone | {alone:.1f} MB |
| with {count} viewers, at first and {passed:.0f} s later | {before:.1f} MB, {after:.1f} MB |
| processor time of the server with them | {used:.3f} of a core |
| cycles a second that each gets | {each:.1f} |

Target: under 120 MB, and no growth.

The run itself, {_TURNS} turns without and {_TURNS} with {count} viewers, one after the other (the
process that has the cycle; HTTP and the workbench are processes of their own), ms:

| | cycles | processor time for each | a cycle takes | 99 % | begins too late by | 99 % |
| --- | --- | --- | --- | --- | --- | --- |
{without.row("nobody looks")}
{beside.row(f"{count} viewers")}

Processor time for each cycle with them ÷ without: **{share:.2f}**."""
