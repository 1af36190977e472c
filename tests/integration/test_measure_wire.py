"""``abbe measure`` beside a laser that lies: turned, in another unit, frozen, slipped, re-zeroed.

On the simulated bridge over real Modbus and a real serial line. What it must not do is write a row
that is not the machine's; what it need not do is go on.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from abbe.drivers.simulated.process import SimulatedProcess
from tests.integration.test_measure import NOISE_UM, campaign_of, driver, off_the_truth
from tests.support.daemon.live_run import MODEL
from tests.support.daemon.measuring import (
    bench,
    configuration,
    line_plan,
    measuring,
    rms,
    write_plan,
)

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

X_LINE = line_plan("x_line", "X", [50, 150, 250, 350, 450])


@pytest.fixture
def shop(tmp_path: Path) -> Iterator[tuple[SimulatedProcess, Path]]:
    shutil.copy(MODEL, tmp_path / "model.toml")
    write_plan(tmp_path / "plan.toml", X_LINE)
    with bench() as process:
        configuration(process.ready, tmp_path)
        yield process, tmp_path


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("factor", "words"),
    [(-1.0, "the sign is turned"), (0.0, "it stands still"), (25.4, "taken for inches")],
)
def test_a_laser_that_does_not_follow_the_machine_gives_no_rows_but_its_zero(
    shop: tuple[SimulatedProcess, Path], factor: float, words: str
) -> None:
    process, folder = shop
    process.order("factor", by=factor)
    # 25.4 times the scatter, too, and yet steady
    limited(folder, max_spread=50.0)
    with measuring(folder / "plan.toml", folder / "config.toml", folder / "campaign.csv") as run:
        machine = driver(process, run, folder)
        machine.read(0)
        for number in (1, 2, 3):
            since = len(run.events)
            machine.to(number)
            said = run.until(lambda e: e["event"] == "doubt", since=since)
            assert words in said["text"]
            assert "not kept" in said["text"]
        # set right, it goes on, from another zero
        process.order("factor", by=1.0)
        since = len(run.events)
        machine.to(4)
        run.until(lambda e: e["event"] == "doubt", since=since)
        machine.read(5, 6, 7)
        run.end()
    found = campaign_of(folder)
    assert found.n == 4
    # three rows' scatter
    assert rms(off_the_truth(process, found)) < 4.0 * NOISE_UM
    assert "Traceback" not in run.said


@pytest.mark.thorough
@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("factor", "words"), [(25.4, "taken for inches"), (1000.0, "µm that are taken for mm")]
)
def test_another_unit_is_told_though_no_reading_is_ever_steady(
    shop: tuple[SimulatedProcess, Path], factor: float, words: str
) -> None:
    """The laser's 0.1 µm of scatter become 2.5 and 100 µm: not one target counts."""
    process, folder = shop
    limited(folder, max_spread=0.6)
    process.order("factor", by=factor)
    with measuring(folder / "plan.toml", folder / "config.toml", folder / "campaign.csv") as run:
        machine = driver(process, run, folder)
        machine.beyond_the_first()
        run.until(lambda e: "mm from the next target" in e["text"])
        assert run.kinds("doubt") == []
        for number in (0, 1, 2):
            since = len(run.events)
            machine.to(number)
            said = run.until(lambda e: e["event"] == "doubt", since=since)
            assert words in said["text"]
            assert "not kept" in said["text"]
        assert len(run.kinds("doubt")) == 3
        assert run.kinds("row") == []
        # set right, it goes on
        process.order("factor", by=1.0)
        machine.read(3, 4, 5)
        assert len(run.kinds("doubt")) == 3
        run.end()
    found = campaign_of(folder)
    assert found.n == 3
    assert rms(off_the_truth(process, found)) < 4.0 * NOISE_UM
    assert "Traceback" not in run.said


def limited(folder: Path, *, max_spread: float) -> None:
    """Have readings count whose scatter is not more than so many µm."""
    config = folder / "config.toml"
    text = config.read_text("utf-8")
    assert text.count("[measure]\n") == 1
    config.write_text(text.replace("[measure]\n", f"[measure]\nmax_spread = {max_spread}\n"))


@pytest.mark.thorough
def test_counts_lost_and_a_zero_set_on_the_way_begin_a_part_of_their_own(
    shop: tuple[SimulatedProcess, Path],
) -> None:
    """54 µm less than `jump` on the way back, and a silent reset in the middle of the way there."""
    process, folder = shop
    with measuring(folder / "plan.toml", folder / "config.toml", folder / "campaign.csv") as run:
        machine = driver(process, run, folder)
        machine.read(0, 1)
        process.order("reset")
        machine.read(2, 3, 4, 5, 6)
        assert "it was reset" in run.kinds("new zero")[0]["text"]
        process.order("slip", by=0.054)
        machine.read(7)
        assert re.search(r"has slipped by 5[345]", run.kinds("new zero")[1]["text"])
        machine.read(8, 9)
        assert run.wait() == 0, run.said
    found = campaign_of(folder)
    assert found.n == 10
    assert found.conditions.setup is not None
    # the last count may have been lost already between the same two targets on the way there
    parts = [str(s) for s in found.conditions.setup]
    assert parts == ["x_line"] * 2 + ["x_line.2"] + ["x_line.2-2"] * 4 + ["x_line.3"] * 3
    assert rms(off_the_truth(process, found)) < NOISE_UM


@pytest.mark.thorough
def test_counts_lost_on_the_way_there_are_noticed_on_the_way_back_and_harm_no_row(
    shop: tuple[SimulatedProcess, Path],
) -> None:
    """54 µm between the second and third target: the rows are there, and count apart."""
    process, folder = shop
    with measuring(folder / "plan.toml", folder / "config.toml", folder / "campaign.csv") as run:
        machine = driver(process, run, folder)
        machine.read(0, 1)
        process.order("slip", by=0.054)
        machine.read(2, 3, 4, 5, 6, 7)
        assert run.kinds("new zero") == []
        machine.read(8, 9)
        assert re.search(r"has slipped by 5[345]", run.kinds("new zero")[0]["text"])
        assert "already on the way there" in run.kinds("note")[-1]["text"]
        assert run.wait() == 0, run.said
    text = (folder / "campaign.csv").read_text("utf-8")
    assert text.count("# zeros_at = [") == 1
    found = campaign_of(folder)
    assert found.n == 10
    assert found.conditions.setup is not None
    parts = [str(s) for s in found.conditions.setup]
    assert parts == ["x_line"] * 2 + ["x_line.1-2"] * 6 + ["x_line.2"] * 2
    assert rms(off_the_truth(process, found)) < NOISE_UM
