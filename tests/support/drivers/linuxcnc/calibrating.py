"""``abbe calibrate`` in its own process, and the operator of the LinuxCNC that it measures."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import threading
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.support.drivers.linuxcnc.measured_mill import MeasuredMill

PATIENCE = 180.0
"""s that a step may take on a busy machine."""
STEPS_AGAIN = 2.0
"""s after which a line that a step has not brought to its end is stepped on."""


class CalibrateRun:
    """The command as typed; its lines are read as they come.

    Parameters
    ----------
    folder
        Where it is typed.
    words
        What follows ``abbe``.
    """

    def __init__(self, folder: Path, *words: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "abbe.daemon", *words],
            cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, encoding="utf-8",
        )  # fmt: skip
        self.lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line.rstrip())

    @property
    def said(self) -> str:
        """All that it said."""
        return "\n".join(self.lines)

    @property
    def over(self) -> bool:
        """Whether it has ended."""
        return self.process.poll() is not None

    def until(self, text: str, patience: float = PATIENCE) -> None:
        """Wait for a line that contains a text."""
        deadline = time.monotonic() + patience
        while not any(text in line for line in list(self.lines)):
            assert not self.over, f"ended before {text!r}:\n{self.said}"
            assert time.monotonic() < deadline, f"{text!r} not seen:\n{self.said}"
            time.sleep(0.02)

    def wait(self, patience: float = PATIENCE) -> int:
        """Its exit status."""
        status = self.process.wait(patience)
        self._reader.join(5.0)
        return status

    def end(self, number: int = signal.SIGINT) -> int:
        """Ask it to end; its exit status."""
        self.process.send_signal(number)
        return self.wait()

    def close(self) -> None:
        """End whatever is left."""
        if not self.over:
            self.process.kill()
        self.process.wait()
        self._reader.join(5.0)
        if self.process.stdout is not None:
            self.process.stdout.close()


@contextmanager
def calibrating(folder: Path, *words: str) -> Iterator[CalibrateRun]:
    """A calibration that ends with the context."""
    run = CalibrateRun(folder, *words)
    try:
        yield run
    finally:
        run.close()


class ProgramRun:
    """The operator: runs a plan's program line by line, goes on when a target was read.

    Where the program stops for that, the laser is stood up. A program that is begun anew passes the
    targets that were read.

    Parameters
    ----------
    mill
        The machine.
    program, plan, campaign
        Its files.
    """

    def __init__(self, mill: MeasuredMill, program: Path, plan: Path, campaign: Path) -> None:
        self._mill = mill
        self._program = program
        self._lines = program.read_text("ascii").splitlines()
        self._campaign = campaign
        self._ways = [s["read"][0][0] for s in tomllib.loads(plan.read_text("utf-8"))["setups"]]

    def rows(self) -> int:
        """How many targets are on the disk."""
        if not self._campaign.exists():
            return 0
        lines = self._campaign.read_text("utf-8").splitlines()
        return max(0, sum(not line.startswith("#") for line in lines) - 1)

    def drive(self, run: CalibrateRun, targets: int | None = None) -> None:
        """Run the program to its end, or until so many targets were read; then it is stopped."""
        self._mill.order("load", str(self._program))
        while targets is None or self.rows() < targets:
            self._mill.order("step")
            if self._stands(run):
                return
        self._mill.order("abort")

    def _stands(self, run: CalibrateRun) -> bool:
        """Wait until the line was carried out and what is to be done there; whether it is over."""
        began = time.monotonic()
        time.sleep(0.03)
        while (passed := time.monotonic() - began) < PATIENCE:
            idle, rests, moved = self._mill.state()
            following = self._lines[moved] if 0 < moved < len(self._lines) else ""
            if following == self._lines[-1] and rests:
                self._mill.order("abort")
                return True
            if idle and moved > 1:
                return True
            if found := re.match(r"\(target (\d+)\)", following):
                if self.rows() >= int(found[1]):
                    return False
            elif rests or passed > STEPS_AGAIN:
                if following.startswith("(set up"):
                    stops = sum(line.startswith("(set up") for line in self._lines[:moved])
                    self._mill.laser.order("place", u=self._ways[stops])
                time.sleep(0.15)  # a machine stands there for a moment, too
                return False
            assert not (found and run.over), f"ended at {following}:\n{run.said}"
            time.sleep(0.02)
        raise AssertionError(f"stands at {following}:\n{run.said}")
