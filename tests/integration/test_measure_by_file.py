"""An instrument that cannot be linked: the machine is followed, its file matched afterwards."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.drivers.simulated.process import SimulatedProcess
from tests.integration.test_measure import NOISE_UM, driver, off_the_truth
from tests.support.daemon.command_line import abbe
from tests.support.daemon.live_run import MODEL
from tests.support.daemon.measuring import (
    PATIENCE,
    SPEED,
    bench,
    configuration,
    driven,
    line_plan,
    measuring,
    rms,
    true_errors,
    write_plan,
)

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

PLACES = [50.0, 150.0, 250.0, 350.0]


@pytest.fixture
def shop(tmp_path: Path) -> Iterator[tuple[SimulatedProcess, Path]]:
    """The machine, and a laser of which the configuration knows only that it writes a file."""
    shutil.copy(MODEL, tmp_path / "model.toml")
    write_plan(tmp_path / "plan.toml", line_plan("x_line", "X", PLACES))
    with bench() as process:
        text = configuration(process.ready, tmp_path).read_text("utf-8")
        start = text.index("[instrument.laser]")
        end = text.index("[instrument.straightness]")
        (tmp_path / "config.toml").write_text(
            text[:start] + '[instrument.laser]\nreads = "file"\n' + text[end:], encoding="utf-8"
        )
        yield process, tmp_path


def read(folder: Path, name: str) -> Campaign:
    return read_campaign(folder / name, load_model(folder / "model.toml").machine)


def test_a_file_of_readings_becomes_rows_with_places_times_and_temperatures(
    shop: tuple[SimulatedProcess, Path],
) -> None:
    process, folder = shop
    seen: list[tuple[float, str, float]] = []
    visits = folder / "visits.csv"
    with measuring(folder / "plan.toml", folder / "config.toml", visits) as run:
        machine = driver(process, run, folder)
        for k, x in enumerate([*PLACES, *reversed(PLACES)]):
            machine.read(k)
            # what the laser's own software writes down: where the point is, less the target
            at = process.order("where")["at"]
            actual = at[0] * 1e3 + float(true_errors(process, [at])[0][0])
            seen.append((x, "+-"[k >= len(PLACES)], actual - x * 1e3))
        assert run.wait() == 0, run.said
    assert "reading is in the instrument's file" in run.kinds("row")[0]["text"]
    # without its readings it is no campaign
    for command in ("fit", "compare"):
        more = ("-o", folder / "no.toml") if command == "fit" else ()
        done = abbe(command, folder / "model.toml", visits, *more)
        assert done.status == 1
        assert "value" in done.err
    file = folder / "laser.csv"

    def write(rows: list[tuple[float, str, float]]) -> None:
        lines = [f"{x},1,{way},{7.7 + value:.4f}" for x, way, value in rows]
        file.write_text("position,run,direction,deviation [um]\n" + "\n".join(lines) + "\n")

    words = ("import-campaign", file, "--as", "iso230-2", "--axis", "X", "--visits", visits,
             "-o", folder / "campaign.csv")  # fmt: skip
    write(seen)
    done = abbe(*words)
    assert done.status == 0, done.err
    assert "8 readings" in done.out
    found = read(folder, "campaign.csv")
    assert rms(off_the_truth(process, found)) < NOISE_UM
    assert (np.diff(found.conditions.time) > 0.0).all()
    assert "T_x1" in found.conditions.signals
    assert set(found.setups) == {"x_line"}
    kept = (folder / "campaign.csv").read_bytes()
    # whatever does not fit is refused, and nothing is written
    for wrong, says in (
        (seen[:-1], "target X 50 from above: the file has 0 readings"),
        ([*seen, seen[0]], "target X 50 from below: the file has 2 readings"),
        ([(x + 1.0, way, v) for x, way, v in seen], "no target where the machine stood"),
        ([(x, "-+"[way == "-"], v) for x, way, v in seen[1:]], "the machine stood there 1 times"),
    ):
        write(wrong)
        done = abbe(*words)
        assert done.status == 1, says
        assert says in done.err
        assert (folder / "campaign.csv").read_bytes() == kept
    write(seen)
    done = abbe(*words, "--component", "Y")
    assert "does not hold what x_line reads" in done.err
    done = abbe(*words, "--setup", "zz")
    assert "one of x_line" in done.err
    done = abbe("import-campaign", file, "--as", "iso230-2", "--axis", "Y", "--visits", visits,
                "-o", folder / "no.csv")  # fmt: skip
    assert "of another axis" in done.err
    # a campaign that has its readings is no file of visits, nor gone on with
    done = abbe(*words[:7], folder / "campaign.csv", "-o", folder / "no.csv")
    assert "no targets whose readings come afterwards" in done.err
    done = abbe("measure", folder / "plan.toml", folder / "config.toml", "--yes",
                "-o", folder / "campaign.csv")  # fmt: skip
    assert done.status == 1
    assert (folder / "campaign.csv").read_bytes() == kept


def test_a_calibration_is_led_through_by_files_that_are_put_in_place(
    shop: tuple[SimulatedProcess, Path],
) -> None:
    """Followed, stopped for the file, gone on with by the same command, matched, fitted."""
    process, folder = shop
    text = (folder / "config.toml").read_text("utf-8")
    start, end = text.index("[instrument.straightness]"), text.index("[measure]")
    (folder / "config.toml").write_text(text[:start] + text[end:], encoding="utf-8")
    own = folder / "calibration"
    words = ("calibrate", folder / "config.toml", "--folder", own, "--yes", "--time", "2h",
             "--tool", "P=0,0,-150", "--upto")  # fmt: skip
    done = abbe(*words, "plan")
    assert done.status == 0, done.err
    line = (folder / "plan.toml").read_text("utf-8").replace("model.toml", "start.toml")
    (own / "plan.toml").write_text(line, "utf-8")  # by hand: one short line
    command = [sys.executable, "-m", "abbe.daemon", *map(str, words), "measure"]
    visits = own / "visits.csv"
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as guide:
        moves = driven(own / "plan.toml", folder / "model.toml")
        at, number, seen = 0, 0, []
        ends = [k for k, move in enumerate(moves) if move.pop("stands", 0.0)]
        for end in ends:
            process.order("drive", moves=moves[at : end + 1], speed=SPEED)
            at, number = end + 1, number + 1
            _wait_for(lambda n=number: visits.exists() and _rows(visits) >= n, guide)
            place = process.order("where")["at"]
            actual = place[0] * 1e3 + float(true_errors(process, [place])[0][0])
            target = moves[end]["to"][0]
            seen.append((target, "+-"[number > len(PLACES)], actual - target * 1e3))
        assert guide.wait(120) == 0
    # the file is not there: named, nothing written; the steps before it stay done
    done = abbe(*words, "fit")
    assert done.status == 1
    assert f"put them as {own / 'readings' / 'x_line'}.rtl" in done.err
    assert "measure: measuring: done" in done.out
    assert not (own / "campaign.csv").exists()
    lines = [f"{x},1,{way},{7.7 + value:.4f}" for x, way, value in seen]
    file = own / "readings" / "x_line.csv"
    file.write_text("position,run,direction,deviation [um]\n" + "\n".join(lines[1:]) + "\n")
    done = abbe(*words, "fit")
    assert "the file has 0 readings, the machine stood there 1 times" in done.err
    assert not (own / "campaign.csv").exists()
    file.write_text("position,run,direction,deviation [um]\n" + "\n".join(lines) + "\n")
    done = abbe(*words, "fit")
    assert done.status == 0, done.err
    assert "8 readings of 1 file matched with their targets" in done.out
    assert rms(off_the_truth(process, read(folder, "calibration/campaign.csv"))) < NOISE_UM
    assert load_model(own / "fitted.toml").fit["cautious"] is True
    # another file in its place: matched and fitted again
    file.write_text(file.read_text("utf-8").replace("position,run", "position, run"))
    assert "matched with their targets" in abbe(*words, "fit").out


def _rows(path: Path) -> int:
    lines = path.read_text("utf-8").splitlines()
    return max(0, sum(not line.startswith("#") for line in lines) - 1)


def _wait_for(what: Callable[[], bool], guide: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + PATIENCE
    while not what():
        assert guide.poll() is None
        assert time.monotonic() < until
        time.sleep(0.02)
