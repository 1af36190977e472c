"""``abbe calibrate`` killed in its check and called again: nothing lost or doubled."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.daemon.calibration.state import CalibrationState
from tests.support.daemon.live_run import MODEL
from tests.support.daemon.measuring import (
    PATIENCE,
    SPEED,
    bench,
    configuration,
    driven,
    line_plan,
    write_plan,
)

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

PLACES = [60, 220, 380, 540]
READ = [*PLACES, PLACES[0]]
"""Where it is read: a line that is driven one way ends where it began."""
DONE = {
    "start": (["model.toml"], "start.toml"),
    "plan": (["start.toml"], "plan.toml"),
    "measure": (["plan.toml"], "campaign.csv"),
    "fit": (["start.toml", "campaign.csv"], "fitted.toml"),
    "diagnose": (["fitted.toml", "campaign.csv"], "calibrated.toml"),
    "check-plan": (["calibrated.toml", "campaign.csv"], "check.toml"),
}
"""Steps before the check: what each was made from, and what it has made."""


def begun(folder: Path, config: Path) -> Path:
    """A calibration of which all is done but the check: one line, which counts in one go."""
    own = folder / "c"
    own.mkdir()
    for name in ("start.toml", "fitted.toml", "calibrated.toml"):
        shutil.copy(MODEL, own / name)
    plan = line_plan("01_laser", "X", PLACES, both_ways=False)
    for name in ("plan.toml", "check.toml"):
        text = write_plan(own / name, plan).read_text("utf-8")
        (own / name).write_text(text.replace("beyond", "in_one_go = true\nbeyond", 1), "utf-8")
    (own / "campaign.csv").write_text("# measured before\n", "utf-8")
    state = CalibrationState.read(own, config)
    for step, (made_from, _) in DONE.items():
        places = [folder / n if n == "model.toml" else own / n for n in made_from]
        state.note(step, places)
    return own


@contextmanager
def calibrating(config: Path, own: Path) -> Iterator[subprocess.Popen[str]]:
    """The command as it is typed, nobody asked."""
    with (own.parent / "said.txt").open("a", encoding="utf-8") as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "abbe.daemon", "calibrate", str(config), "--folder", str(own),
             "--tool", "P=0,0,-150", "--yes", "--upto", "check"],
            stdout=said, stderr=said, text=True,
        )  # fmt: skip
        try:
            yield process
        finally:
            process.kill()
            process.wait()


def rows(own: Path) -> list[str]:
    """The set-ups of the rows of the check that are on the disk."""
    path = own / "check.csv"
    lines = path.read_text("utf-8").splitlines() if path.exists() else []
    return [line.split(",")[1] for line in lines if not line.startswith("#")][1:]


def wait_for(own: Path, count: int, guide: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + PATIENCE
    while len(rows(own)) < count:
        said = (own.parent / "said.txt").read_text("utf-8")[-2000:]
        assert guide.poll() is None, said
        assert time.monotonic() < deadline, said
        time.sleep(0.05)


def test_killed_in_its_check_it_goes_on_with_nothing_lost_or_doubled(tmp_path: Path) -> None:
    shutil.copy(MODEL, tmp_path / "model.toml")
    said = tmp_path / "said.txt"
    with bench() as process:
        config = configuration(process.ready, tmp_path)
        own = begun(tmp_path, config)
        moves = driven(own / "check.toml", tmp_path / "model.toml")
        ends = [k for k, move in enumerate(moves) if move.get("stands")]
        ways = [{k: v for k, v in move.items() if k != "stands"} for move in moves]

        def drive(number: int) -> None:
            first = 0 if number == 0 else ends[number - 1] + 1
            process.order("drive", moves=ways[first : ends[number] + 1], speed=SPEED)

        with calibrating(config, own) as guide:
            deadline = time.monotonic() + PATIENCE
            while not said.exists() or "next: target 1 of 5" not in said.read_text("utf-8"):
                assert guide.poll() is None, said.read_text("utf-8")
                assert time.monotonic() < deadline
                time.sleep(0.05)
            for number in range(2):
                drive(number)
                wait_for(own, number + 1, guide)
            os.kill(guide.pid, signal.SIGKILL)
            guide.wait()
        state = json.loads((own / "calibration.json").read_text("utf-8"))
        assert list(state["steps"]) == list(DONE)
        kept = (own / "check.csv").read_bytes()

        with calibrating(config, own) as guide:
            deadline = time.monotonic() + PATIENCE
            while said.read_text("utf-8").count("next: target 1 of 5") < 2:
                assert guide.poll() is None, said.read_text("utf-8")
                assert time.monotonic() < deadline
                time.sleep(0.05)
            for number in range(len(READ)):
                drive(number)
                if number < len(READ) - 1:
                    wait_for(own, 2 + number + 1, guide)
            assert guide.wait(PATIENCE) == 0, said.read_text("utf-8")

    text = said.read_text("utf-8")
    assert text.count("5/9 diagnose: what is missing: done") == 2
    assert text.count("7/9 check: these lines measured\n") == 2
    assert "Traceback" not in text
    # what was there is there, byte for byte; the line is measured anew, whole, from its own zero
    assert (own / "check.csv").read_bytes().endswith(b"\n")
    table = kept[kept.index(b"\ntime,setup") :]
    assert table in (own / "check.csv").read_bytes()
    assert rows(own) == ["01_laser"] * 2 + ["01_laser.2"] * 5
    found = read_campaign(own / "check.csv", load_model(MODEL).machine).conditions
    assert found.positions["X"] == pytest.approx([*READ[:2], *READ], abs=0.01)
    assert (np.diff(found.time) > 0.0).all()
    state = json.loads((own / "calibration.json").read_text("utf-8"))
    assert list(state["steps"]) == [*DONE, "check"]
    again = subprocess.run(
        [sys.executable, "-m", "abbe.daemon", "measure", str(own / "check.toml"), str(config),
         "-o", str(own / "check.csv"), "--yes"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "all 5 targets" in again.stdout, again.stdout + again.stderr
