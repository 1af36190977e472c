"""The workbench with viewers: memory and processor time of its server while browsers stream a run.

A simulated machine is corrected with records and HTTP; so many viewers read the live stream. The
server's resident memory and its processor time are the system's own figures (``/proc``). Usage:
``python -m benchmarks.workbench [SECONDS] [VIEWERS]``.
"""

from __future__ import annotations

import http.client
import os
import sys
import tempfile
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from tests.support.daemon.live_run import compensating, live_run, machine
from tests.support.daemon.workbench import OpenedWorkbench, opened

SETTLED = 10.0
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


def resident(pid: int) -> float:
    """Resident memory of a process, MB."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return int(next(line.split()[1] for line in lines if line.startswith("VmRSS"))) / 1024.0


def spent(pid: int) -> float:
    """Processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Measure and print."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 120.0
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 20
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
            time.sleep(SETTLED)
            before, began, cpu = resident(pid), time.monotonic(), spent(pid)
            cycles = sum(v.cycles for v in viewers)
            time.sleep(seconds)
            passed = time.monotonic() - began
            each = (sum(v.cycles for v in viewers) - cycles) / count / passed
            used = (spent(pid) - cpu) / passed
            print(f"alone {alone:.1f} MB; {count} viewers for {passed:.0f} s:")
            print(
                f"{before:.1f} MB at first, {resident(pid):.1f} MB at the end; {used:.3f} of a core"
            )
            print(f"{each:.1f} cycles a second for each; load of the host {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
