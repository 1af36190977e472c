"""A Dask scheduler and workers as processes of their own, over sockets of this computer."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[3]
_PATIENCE = 90.0


class DaskProcesses:
    """A scheduler and its workers; each can be killed."""

    def __init__(self, folder: Path, workers: int, tls: Sequence[str] = ()) -> None:
        self._file = folder / "scheduler.json"
        self._tls = list(tls)
        host = "tls://127.0.0.1" if tls else "tcp://127.0.0.1"
        self._log = (folder / "dask.log").open("w")
        self.scheduler = self._start(
            "dask_scheduler", "--host", host, "--port", "0", "--no-show",
            "--scheduler-file", str(self._file),
        )  # fmt: skip
        try:
            self.address = self._announced()
            self.workers = [self.worker() for _ in range(workers)]
        except BaseException:
            self.end()
            raise

    def _start(self, what: str, *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{what}", "--no-dashboard", *arguments]
        return subprocess.Popen(
            [*command, *self._tls], cwd=ROOT, stdout=self._log, stderr=self._log
        )

    def worker(self) -> subprocess.Popen[bytes]:
        """One more worker, of one thread."""
        return self._start(
            "dask_worker", self.address, "--nthreads", "1", "--no-nanny", "--host", "127.0.0.1",
        )  # fmt: skip

    def _announced(self) -> str:
        end = time.monotonic() + _PATIENCE
        while time.monotonic() < end:
            try:
                return str(json.loads(self._file.read_text())["address"])
            except (OSError, ValueError):
                time.sleep(0.02)
        raise TimeoutError("the scheduler did not say where it is")

    def end(self) -> None:
        """End all that is left."""
        for process in (self.scheduler, *getattr(self, "workers", ())):
            if process.poll() is None:
                process.send_signal(signal.SIGKILL)
            process.wait()
        self._log.close()


@contextmanager
def dask_processes(folder: Path, workers: int, tls: Sequence[str] = ()) -> Iterator[DaskProcesses]:
    """Run them for a while."""
    made = DaskProcesses(folder, workers, tls)
    try:
        yield made
    finally:
        made.end()
