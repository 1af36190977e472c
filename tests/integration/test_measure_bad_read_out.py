"""``abbe measure`` beside a read-out of errors that is late by seconds, in inches, or turned.

An errors' reading has no nominal value. What shows its faults is the nudge before the first target,
and that it still changes where the machine stands.
"""

from __future__ import annotations

import os
import shutil
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.drivers.simulated.process import SimulatedProcess
from tests.integration.test_measure import campaign_of, driver
from tests.support.daemon.bad_read_out import BadReadOut
from tests.support.daemon.live_run import MODEL, set_fault
from tests.support.daemon.measuring import (
    SPEED,
    Driver,
    MeasureRun,
    bench,
    configuration,
    driven,
    line_plan,
    measuring,
    true_errors,
    write_plan,
)

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

LINE = line_plan("s", "X", [50, 250, 450, 650], instrument="straightness", u=(0.0, 0.0, 1.0),
                 free='["zero", "slope"]', sd=0.8)  # fmt: skip
OFF_UM = 0.6
"""µm: what an honest row is off by at most: here the machine comes back within 0.03."""


@contextmanager
def bare_shop(
    folder: Path,
    *,
    late: float = 0.0,
    factor: float = 1.0,
    nudge: float = 0.05,
    garbled: float = 0.0,
) -> Iterator[tuple[SimulatedProcess, BadReadOut]]:
    """The machine and the read-out, with files to measure by."""
    shutil.copy(MODEL, folder / "model.toml")
    plan = write_plan(folder / "plan.toml", LINE)
    text = plan.read_text("utf-8")
    plan.write_text(text.replace("beyond = 2\n", f"beyond = 2\nnudge = {nudge}\n"), "utf-8")
    with bench() as process:
        set_fault(process.ready["port"], "repeatability", 30)
        read_out = BadReadOut(process.ready["laser"], late, factor, garbled)
        with read_out.served():
            config = configuration(process.ready, folder)
            text = config.read_text("utf-8").replace(process.ready["laser"], read_out.port)
            text = text.replace("incremental = true", "incremental = false")
            config.write_text(text, "utf-8")
            yield process, read_out


@contextmanager
def measured(folder: Path, process: SimulatedProcess) -> Iterator[tuple[MeasureRun, Driver]]:
    """``abbe measure`` in such a shop, and who drives the machine."""
    plan = folder / "plan.toml"
    with measuring(plan, folder / "config.toml", folder / "campaign.csv") as run:
        run.until(lambda e: e["event"] == "next")
        yield run, Driver(process, run, plan, folder / "model.toml")


@contextmanager
def shop(folder: Path, **faults: float) -> Iterator[tuple[SimulatedProcess, MeasureRun, Driver]]:
    """Both."""
    with bare_shop(folder, **faults) as (process, _), measured(folder, process) as (run, machine):
        yield process, run, machine


def off(process: SimulatedProcess, found: Campaign) -> float:
    """By how much rows are off the exact machine's straightness at most, but for a line, µm."""
    at = np.stack([found.conditions.positions[a] for a in "XYZ"], axis=1)
    wrong = 1e3 * found.value - true_errors(process, at.tolist())[:, 2]
    line = np.polynomial.polynomial.polyfit(at[:, 0], wrong, 1)
    return float(np.abs(wrong - np.polynomial.polynomial.polyval(at[:, 0], line)).max())


def test_an_honest_one_follows_and_its_rows_are_the_machine_s(tmp_path: Path) -> None:
    with shop(tmp_path) as (process, run, machine):
        machine.all()
        assert run.wait() == 0, run.said
        assert run.kinds("doubt") == []
        assert run.kinds("withdrawn") == []
        assert any("straightness follows: it shows +0.0" in e["text"] for e in run.kinds("note"))
        found = campaign_of(tmp_path)
        assert found.n == 8
        assert off(process, found) < OFF_UM


@pytest.mark.parametrize(
    ("factor", "words"), [(1.0 / 25.4, "switched to inches"), (-1.0, "its sign is turned")]
)
def test_another_unit_and_a_turned_sign_give_no_row(
    tmp_path: Path, factor: float, words: str
) -> None:
    with shop(tmp_path, factor=factor) as (_, run, machine):
        for number in (0, 1):
            since = len(run.events)
            machine.to(number)
            said = run.until(lambda e: e["event"] == "doubt", since=since)
            assert "not kept" in said["text"]
        assert words in run.kinds("doubt")[0]["text"]
        assert run.kinds("row") == []
        run.end()


def test_gone_on_with_after_a_kill_it_has_to_show_the_move_again(tmp_path: Path) -> None:
    """Nobody knows what was done to it meanwhile: here its sign was turned."""
    with bare_shop(tmp_path) as (process, read_out):
        with measured(tmp_path, process) as (run, machine):
            machine.read(0, 1)
            os.kill(run.process.pid, signal.SIGKILL)
            run.process.wait()
        kept = (tmp_path / "campaign.csv").read_bytes()
        read_out.factor = -1.0
        with measured(tmp_path, process) as (run, machine):
            # the program is gone on with where it was
            process.order("drive", moves=[{"to": machine.place(2)}], speed=SPEED)
            said = run.until(lambda e: e["event"] == "doubt")
            assert "go Z +0.050 mm aside of this target" in said["text"]
            # it is begun again: shown, and not kept
            since = len(run.events)
            machine.to(0)
            said = run.until(lambda e: e["event"] == "doubt", since=since)
            assert "its sign is turned" in said["text"]
            assert (tmp_path / "campaign.csv").read_bytes() == kept
            read_out.factor = 1.0
            # set right, it is gone on with at the target that is next, nudged there by hand
            for target, height in ((2, -180.05), (2, -179.95), (2, -180.05), (2, -180.0)):
                since = len(run.events)
                place = [*machine.place(target)[:2], height]
                way = [{"to": [place[0] - 2.0, *place[1:]]}, {"to": place}]
                process.order("drive", moves=way, speed=SPEED)
                if height == -179.95:
                    run.until(lambda e: "back to this target" in e["text"], since=since)
            run.rows(1)
            machine.read(3, 4, 5, 6, 7)
            assert run.wait() == 0, run.said
            assert any("follows: it shows" in e["text"] for e in run.kinds("note"))
        found = campaign_of(tmp_path)
        assert found.n == 8
        assert off(process, found) < OFF_UM


def test_switched_off_meanwhile_it_has_to_show_the_move_again(tmp_path: Path) -> None:
    with bare_shop(tmp_path) as (process, read_out), measured(tmp_path, process) as (run, machine):
        machine.read(0, 1)
        read_out.silent = True
        run.until(lambda e: e["event"] == "lost")
        read_out.silent, read_out.factor = False, 1.0 / 25.4
        run.until(lambda e: e["event"] == "back")
        since = len(run.events)
        machine.to(2)
        said = run.until(lambda e: e["event"] == "doubt", since=since)
        assert "was not seen to follow the machine since it was left alone" in said["text"]
        assert len(run.kinds("row")) == 2
        read_out.factor = 1.0
        again = driver(process, run, tmp_path)
        again.to(0)
        run.until(lambda e: e["event"] == "repeated", since=since)
        assert any("follows: it shows" in e["text"] for e in run.events[since:])
        again.read(2, 3, 4, 5, 6, 7)
        assert run.wait() == 0, run.said
        assert off(process, campaign_of(tmp_path)) < OFF_UM


def test_without_the_nudge_nothing_is_kept_of_a_plan_that_has_it(tmp_path: Path) -> None:
    with shop(tmp_path) as (process, run, machine):
        process.order("drive", moves=[{"to": machine.place(0)}], speed=3000.0)
        said = run.until(lambda e: e["event"] == "doubt")
        assert "Z +0.050 mm aside of the first target" in said["text"]
        assert run.kinds("row") == []
        run.end()


@pytest.mark.thorough
@pytest.mark.one_in(2)
@pytest.mark.parametrize("nudge", [0.0, 0.05])
def test_one_that_is_late_by_seconds_gives_no_row_of_the_target_before(
    tmp_path: Path, nudge: float
) -> None:
    """What was kept too soon is seen to change where the machine stands, and is taken back."""
    with shop(tmp_path, late=1.5, nudge=nudge) as (process, run, _):
        moves = driven(tmp_path / "plan.toml", tmp_path / "model.toml", stands=4.0)
        process.order("drive", moves=moves, speed=SPEED)
        while process.order("where")["at_move"] < len(moves):
            time.sleep(0.2)
        if run.process.poll() is None:
            run.end()
        run.wait()
        assert any("it is slow, or late" in e["text"] for e in run.events)
        found = campaign_of(tmp_path)
        assert found.n
        # 2 stated uncertainties are no change; they count against each other in the line
        assert off(process, found) < 2.0 * 0.8 + OFF_UM


@pytest.mark.thorough
def test_of_a_line_that_garbles_two_answers_of_five_the_others_count(tmp_path: Path) -> None:
    with shop(tmp_path, garbled=0.4) as (process, run, machine):
        machine.all()
        assert run.wait() == 0, run.said
        # the machine's positions are read on, however long the instrument is waited for
        assert not [e for e in run.events if "no position" in e["text"]]
        assert any("~#" in e["text"] for e in run.kinds("unsteady"))
        found = campaign_of(tmp_path)
        assert found.n == 8
        assert off(process, found) < OFF_UM
