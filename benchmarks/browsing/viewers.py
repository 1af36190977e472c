"""Many viewers: memory and processor time of the server while they stream a run."""

from __future__ import annotations

import http.client
import os
import tempfile
import threading
import time
from pathlib import Path

from benchmarks.browsing.taken import resident, spent
from tests.support.daemon.live_run import compensating, live_run, machine
from tests.support.daemon.workbench import OpenedWorkbench, opened

_SETTLED = 10.0
"""s after which figures are taken."""


class Viewer(threading.Thread):
    """A browser that looks at the live view: counts the cycles that it gets."""

    def __init__(self, bench: OpenedWorkbench) -> None:
        super().__init__(daemon=True)
        self._bench = bench
        self.cycles = 0

    def run(self) -> None:
        """Read until the server ends."""
        connection = http.client.HTTPConnection("127.0.0.1", self._bench.port, timeout=60)
        asked = {"host": f"127.0.0.1:{self._bench.port}", "cookie": self._bench.cookie}
        connection.request("GET", "/api/live/stream", headers=asked)
        for line in connection.getresponse():
            self.cycles += line.startswith(b"event: cycle")


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
            viewers = [Viewer(bench) for _ in range(count)]
            for viewer in viewers:
                viewer.start()
            time.sleep(_SETTLED)
            before, began, cpu = resident(pid), time.monotonic(), spent(pid)
            cycles = sum(v.cycles for v in viewers)
            time.sleep(seconds)
            passed = time.monotonic() - began
            each = (sum(v.cycles for v in viewers) - cycles) / count / passed
            used = (spent(pid) - cpu) / passed
            after = resident(pid)
    return f"""### Twenty viewers

A simulated machine corrected with records and HTTP, its live view streamed to {count} viewers at a
time for {passed:.0f} s; load of the host {os.getloadavg()[0]:.1f}.

| | |
| --- | --- |
| memory of the server, alone | {alone:.1f} MB |
| with {count} viewers, at first and {passed:.0f} s later | {before:.1f} MB, {after:.1f} MB |
| processor time of the server with them | {used:.3f} of a core |
| cycles a second that each gets | {each:.1f} |

Target: under 120 MB, and no growth."""
