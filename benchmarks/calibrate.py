"""``make demo-calibrate``: the simulated CMM calibrated from its plan to its certificate by nobody.

Starts the simulated machine with its laser, lets ``abbe calibrate --yes`` go through all its steps,
and plays the machine's operator: runs the program, and sets the laser up where it stops. The model
to begin with lacks a cause that the machine has; it is found on the way. In the end the error on
lines that nobody measured is held against the simulator's truth.

    python -m benchmarks.calibrate [FOLDER] [--time 10h]
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Self

import numpy as np

from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.daemon.demo.prepare import START
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.measuring import (
    SPEED,
    TOOL,
    configuration,
    driven,
    rms,
    unseen_lines,
)

HIDDEN = 'kind = "angular"\naxis = "Y"\nabout = "Z"'
"""The yaw of the bridge: what the start model lacks."""
MEASURE = """
[measure]
still_for = 0.06
settle = 0.0
average = 0.1
"""
_LONGEST = 3600.0
TARGET_TIME = 0.45
"""s of the hall's time for each target: as long as one takes on a quiet computer. By the clock a
busy one had it warm for as long as it was slow, and measured another machine."""


def start_model() -> str:
    """As an engineer would begin: the effects but one, no expansion (the hall stays)."""
    text = re.sub(r'shape = "spline:\d+"', 'shape = "spline:9"', START.read_text("utf-8"))
    parts = text.split("[[effects]]")
    kept = [p for p in parts if "scale_expansion" not in p and HIDDEN not in p]
    assert len(kept) == len(parts) - 4, "the start model has another order of keys"
    return "[[effects]]".join(kept)


def one_way(plan: Path) -> None:
    """Every line once, one way: this machine has no play, and the demo is shorter."""
    text = plan.read_text("utf-8").replace("both_ways = true", "both_ways = false")
    plan.write_text(re.sub(r"^runs = \d+", "runs = 1", text, flags=re.MULTILINE), "utf-8")


def rows_in(campaign: Path) -> int:
    """Rows of a campaign that grows."""
    if not campaign.exists():
        return 0
    lines = campaign.read_text("utf-8").splitlines()
    return max(0, sum(not line.startswith("#") for line in lines) - 1)


class Guide:
    """``abbe calibrate``, whose lines are shown and read; it ends with the context.

    Parameters
    ----------
    command
        As it is typed.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self._until = time.monotonic() + _LONGEST
        self._asides = 0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self._reader.join()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            print(line, end="", flush=True)
            self._asides += "stood aside of the line" in line

    @property
    def asides(self) -> int:
        """How often an instrument was read at the far end of a nudge, which gives no row."""
        return self._asides

    def until(self, true: Callable[[], bool]) -> None:
        """Wait until something is so."""
        while not true():
            if self._process.poll() is not None:
                raise SystemExit(f"abbe calibrate ended with status {self._process.returncode}")
            if time.monotonic() > self._until:
                raise SystemExit("nothing happens any more")
            time.sleep(0.02)

    def end(self) -> None:
        """Wait for its end, which has to be a good one."""
        if self._process.wait(_LONGEST):
            raise SystemExit(f"abbe calibrate ended with status {self._process.returncode}")


def operate(bench: SimulatedProcess, guide: Guide, plan: Path, model: Path, campaign: Path) -> None:
    """Run a plan's program once it is there, each target held until its row is on the disk."""
    guide.until(campaign.exists)
    moves = driven(plan, model)
    first, rows = 0, 0
    for at in [k for k, move in enumerate(moves) if move.get("stands")]:
        part = [{k: v for k, v in m.items() if k != "stands"} for m in moves[first : at + 1]]
        asides = guide.asides
        bench.order("drive", moves=part, speed=SPEED)
        bench.order("shop", seconds=TARGET_TIME)
        first = at + 1
        if moves[at].get("aside"):
            guide.until(lambda asides=asides: guide.asides > asides)
        else:
            rows += 1
            guide.until(lambda rows=rows: rows_in(campaign) >= rows)
    print(f"operator: {plan.name} is through, {rows} targets")


def calibrated(folder: Path, hours: str, check_hours: str) -> tuple[float, float, float, str]:
    """Calibrate a simulated machine: rms on unseen lines before, by the first model, after, µm."""
    model = folder / "model.toml"
    model.write_text(start_model(), "utf-8")
    files = folder / "calibration"
    tool = "P=" + ",".join(f"{x:g}" for x in TOOL)
    with SimulatedProcess("bench", "--seed", "1", "--time-factor", "0") as bench:
        config = configuration(bench.ready, folder, MEASURE)
        command = [
            sys.executable, "-m", "abbe.daemon", "calibrate", str(config), "--folder", str(files),
            "--time", hours, "--check-time", check_hours, "--tool", tool, "--yes",
            "--controller", "linuxcnc",
        ]  # fmt: skip
        if subprocess.run([*command, "--upto", "plan"], check=False).returncode:
            raise SystemExit("the plan could not be made")
        one_way(files / "plan.toml")
        with Guide(command) as guide:
            operate(bench, guide, files / "plan.toml", files / "start.toml", files / "campaign.csv")
            operate(
                bench, guide, files / "check.toml", files / "calibrated.toml", files / "check.csv"
            )
            guide.end()
        # a cause that was found may be thermal: as warm as at the check's last target
        machine = load_model(files / "start.toml").machine
        read = read_campaign(files / "check.csv", machine).conditions.signals
        warm = {name: float(values[-1]) for name, values in read.items()}
        before, fitted = unseen_lines(bench, files / "fitted.toml", warm)
        _, after = unseen_lines(bench, files / "calibrated.toml", warm)
    had = {e.spec for e in load_model(files / "start.toml").effects}
    added = [e.spec for e in load_model(files / "calibrated.toml").effects if e.spec not in had]
    return rms(before), rms(fitted), rms(after), "; ".join(added)


def main() -> int:
    """Run it; the exit status is 1 where the error has not fallen tenfold."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.calibrate")
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--time", default="10h")
    parser.add_argument("--check-time", default="2h")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="abbe-calibrate-") as made:
        folder = options.folder or Path(made)
        folder.mkdir(parents=True, exist_ok=True)
        before, fitted, after, added = calibrated(folder, options.time, options.check_time)
    print(f"found on the way: {added or 'nothing'}")
    times = f"{before / after:.0f} times better"
    print(f"lines that nobody measured, rms: {before:.2f} µm before, {fitted:.2f} µm by the model")
    print(f"without the cause that was hidden, {after:.2f} µm with what was found: {times}")
    return int(not np.isfinite(after) or before < 10.0 * after)


if __name__ == "__main__":
    sys.exit(main())
