"""``abbe measure`` on the simulated bridge with its laser: rows, faults, what is kept."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.command_line import abbe
from tests.support.daemon.live_run import MODEL
from tests.support.daemon.measuring import (
    QUICK,
    SPEED,
    Driver,
    MeasureRun,
    bench,
    configuration,
    line_plan,
    measuring,
    rms,
    true_errors,
    write_plan,
)

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

NOISE_UM = 0.25
"""What may be left of 0.3 µm of repeatability and 0.1 µm of the laser in an average, µm, rms."""
HELD = 2.0
"""s for which a lost sensor's last value counts in these tests."""
X_LINE = line_plan("x_line", "X", [50, 150, 250, 350, 450])


@pytest.fixture
def shop(tmp_path: Path) -> Iterator[tuple[SimulatedProcess, Path]]:
    """The machine that runs, and a folder with its model and configuration."""
    shutil.copy(MODEL, tmp_path / "model.toml")
    with bench() as process:
        configuration(process.ready, tmp_path)
        yield process, tmp_path


def driver(process: SimulatedProcess, run: MeasureRun, folder: Path) -> Driver:
    run.until(lambda e: e["event"] == "next")
    return Driver(process, run, folder / "plan.toml", folder / "model.toml")


def campaign_of(folder: Path) -> Campaign:
    return read_campaign(folder / "campaign.csv", load_model(folder / "model.toml").machine)


def off_the_truth(process: SimulatedProcess, campaign: Campaign) -> np.ndarray:
    """Rows less the exact machine's errors, each set-up less its mean (its zero), µm."""
    c = campaign.conditions
    at = np.stack([c.positions[a] for a in "XYZ"], axis=1)
    truth = true_errors(process, at.tolist())
    assert c.u is not None
    assert c.setup is not None
    left = campaign.value * 1e3 - np.einsum("ni,ni->n", c.u, truth)
    for name in np.unique(c.setup):
        mine = c.setup == name
        left[mine] -= left[mine].mean()
    return left


def test_a_plan_becomes_a_campaign_that_is_the_machine(
    shop: tuple[SimulatedProcess, Path],
) -> None:
    """Three instruments' lines: every row is the exact chain's, within noise; nobody types."""
    process, folder = shop
    write_plan(
        folder / "plan.toml",
        X_LINE,
        line_plan("z_laser", "Z", [-300, -200, -100]),
        line_plan("tilt", "Y", [100, 300, 500], instrument="angle", reads="rotation",
                  u=(1.0, 0.0, 0.0), sd=0.2),
    )  # fmt: skip
    with measuring(folder / "plan.toml", folder / "config.toml", folder / "campaign.csv") as run:
        driver(process, run, folder).all()
        assert run.wait() == 0, run.said
    assert run.events[-1]["done"] == 10 + 6 + 6
    found = campaign_of(folder)
    assert found.n == 22
    lengths = found.rows(found.kind == Kind.DISPLACEMENT)
    assert rms(off_the_truth(process, lengths)) < NOISE_UM
    c = lengths.conditions
    there = c.setup == "x_line"
    there_and_back = [50, 150, 250, 350, 450, 450, 350, 250, 150, 50]
    assert c.positions["X"][there] == pytest.approx(there_and_back, abs=2e-4)
    assert c.directions["X"][there].tolist() == [1.0] * 5 + [-1.0] * 5
    assert (np.diff(found.conditions.time) > 0.0).all()
    text = (folder / "campaign.csv").read_text("utf-8")
    assert 'seen = [\n#     "feed",\n# ]' in text
    assert set(found.conditions.signals) == {
        "T_x1",
        "T_x2",
        "T_y1",
        "T_y2",
        "T_z1",
        "T_z2",
        "T_amb",
    }
    assert (c.tool == (0.0, 0.0, -150.0)).all()
    assert ((lengths.sd >= 0.3e-3) & (lengths.sd < 0.6e-3)).all()
    tilts = found.rows(found.kind == Kind.ROTATION)
    predicted = load_model(MODEL).predict(tilts.conditions).rotation[:, 0]
    left = (tilts.value - predicted) * 1e6
    assert rms(left - left.mean()) < 1.5  # what that model, fitted elsewhere, is wrong by
    for command in ("compare", "diagnose"):
        done = abbe(command, folder / "model.toml", folder / "campaign.csv")
        assert done.status == 0, done.err


def test_beam_broken_laser_restarted_targets_left_out_thermometer_lost(
    shop: tuple[SimulatedProcess, Path],
) -> None:
    """Nothing wrong gets into the campaign, and what was missed is measured in the end."""
    process, folder = shop
    plan = write_plan(folder / "plan.toml", X_LINE)
    with measuring(plan, folder / "config.toml", folder / "campaign.csv") as run:
        machine = driver(process, run, folder)
        machine.read(0, 1)
        # the beam is broken between two targets
        process.order("beam", broken=True)
        lost = run.until(lambda e: e["event"] == "lost")
        assert "no beam" in lost["text"]
        machine.to(2)
        run.until(lambda e: e["event"] == "unsteady" and "no beam" in e["text"])
        process.order("beam", broken=False)
        run.until(lambda e: e["event"] == "back" and "set-up of its own" in e["text"])
        run.rows(3)
        # target 4 is left out
        machine.read(4)
        assert any("left out" in e["text"] for e in run.kinds("missed"))
        # a thermometer is lost for longer than its last value counts
        process.order("thermistors", lost=1)
        run.until(lambda e: e["event"] == "lost" and e.get("signal") == "T_x1")
        time.sleep(HELD)  # longer is no harm
        machine.to(5)
        waits = run.until(lambda e: e["event"] == "unsteady" and "T_x1" in e["text"])
        assert len(run.kinds("row")) == 4
        process.order("thermistors", lost=0)
        run.until(lambda e: e["event"] == "back", since=run.events.index(waits))
        run.rows(5)
        # the laser is switched off and on
        seen = len(run.events)
        process.order("restart", seconds=8.0)
        run.until(lambda e: e["event"] == "back" and "laser" in e["text"], since=seen)
        machine.read(6, 7, 8, 9)
        # what was left out is asked for, and measured
        again = run.until(lambda e: e["event"] == "next" and "was missed" in e["text"])
        assert "350.000" in again["text"]
        machine.to(3)
        assert run.wait() == 0, run.said
    found = campaign_of(folder)
    assert found.n == 10
    assert set(found.setups) == {"x_line", "x_line.2", "x_line.3"}
    assert rms(off_the_truth(process, found)) < NOISE_UM
    assert all(found.setups[s].free == ("zero",) for s in found.setups)


@pytest.mark.thorough
def test_the_operator_stops_the_machine_where_no_target_is(
    shop: tuple[SimulatedProcess, Path],
) -> None:
    """Half-way and just before a target: told, and no row is made of it; then it goes on."""
    process, folder = shop
    plan = write_plan(
        folder / "plan.toml", line_plan("x_line", "X", [50, 150, 250], both_ways=False)
    )

    def stop_at(x: float) -> None:
        process.order("drive", moves=[{"to": [x, 450.0, -180.0]}], speed=SPEED)

    with measuring(plan, folder / "config.toml", folder / "campaign.csv") as run:
        machine = driver(process, run, folder)
        machine.read(0)
        for x, away in ((100.0, "50.0"), (149.7, "0.3"), (149.0, "1.0")):
            stop_at(x)
            run.until(lambda e, a=away: f"stands {a}" in e["text"])
        assert len(run.kinds("row")) == 1
        machine.read(1)
        machine.speed = 100.0
        machine.read(2, 3)
        assert run.wait() == 0, run.said
    feeds = [e["rows"][0]["feed"] for e in run.kinds("row")]
    # half of the way of its fifth-degree law is faster; blank where a busy computer did not see it
    seen = [feed for feed in feeds[2:] if feed is not None]
    assert seen
    assert seen == pytest.approx([0.848 * 6000.0] * len(seen), rel=0.05)
    found = campaign_of(folder)
    assert found.conditions.positions["X"] == pytest.approx([50, 150, 250, 50], abs=0.01)
    assert set(found.setups) == {"x_line"}
    assert rms(off_the_truth(process, found)) < NOISE_UM


def test_killed_it_goes_on_and_never_with_another_plan(
    shop: tuple[SimulatedProcess, Path],
) -> None:
    process, folder = shop
    plan, config, out = folder / "plan.toml", folder / "config.toml", folder / "campaign.csv"
    write_plan(plan, X_LINE)
    with measuring(plan, config, out) as run:
        driver(process, run, folder).read(0, 1, 2)
        os.kill(run.process.pid, signal.SIGKILL)
        run.process.wait()
        told = run.kinds("row")
    kept = out.read_text("utf-8")
    assert len(told) == campaign_of(folder).n == 3
    with out.open("a", encoding="utf-8") as file:
        file.write("77.5,x_line,displ")  # as a power cut leaves it
    # another plan, another machine: nothing is touched
    other = write_plan(folder / "other.toml", line_plan("x_line", "X", [50, 150, 250]))
    torn = out.read_bytes()
    for wrong, words in (
        ((other, config), "another plan"),
        ((plan, folder / "b.toml"), "another conf"),
    ):
        text = config.read_text("utf-8").replace("max_rate = 0.5", "max_rate = 0.4")
        (folder / "b.toml").write_text(text, encoding="utf-8")
        done = abbe("measure", *wrong, "-o", out, "--yes")
        assert done.status == 1
        assert words in done.err
        assert out.read_bytes() == torn
    # thresholds may be changed, comments too
    config.write_text("# again\n" + config.read_text("utf-8").replace("0.15", "0.16"), "utf-8")
    with measuring(plan, config, out) as run:
        begun = run.until(lambda e: e["event"] == "resumed")
        assert begun["done"] == 3
        assert out.read_text("utf-8") == kept
        driver(process, run, folder).read(*range(3, 10))
        assert run.wait() == 0, run.said
    found = campaign_of(folder)
    # where it still stands is read once more when it is driven on late
    assert found.n - len(run.kinds("repeated")) == 10
    assert set(found.setups) == {"x_line", "x_line.2"}
    assert rms(off_the_truth(process, found)) < NOISE_UM
    # complete: the same command has nothing to do
    done = abbe("measure", plan, config, "-o", out, "--yes")
    assert done.status == 0
    assert "all 10 targets" in done.out


def test_where_it_still_stands_with_what_was_set_up_before_is_no_target_of_the_next(
    shop: tuple[SimulatedProcess, Path],
) -> None:
    """Two lines that meet: the end of one is the beginning of the other, along another axis."""
    process, folder = shop
    plan = write_plan(
        folder / "plan.toml",
        line_plan("along_x", "X", [350, 250, 150], both_ways=False),
        line_plan("along_y", "Y", [450, 350, 250], both_ways=False),
    )
    with measuring(plan, folder / "config.toml", folder / "campaign.csv") as run:
        machine = driver(process, run, folder)
        machine.read(0, 1, 2, 3)
        run.until(lambda e: e["event"] == "set up" and e["setup"] == "along_y")
        time.sleep(2.0)  # as long as a program may stand there; longer is no harm
        assert len(run.kinds("row")) == 4
        machine.read(4, 5, 6, 7)
        assert run.wait() == 0, run.said
        assert run.kinds("doubt") == run.kinds("repeated") == run.kinds("new zero") == []
    found = campaign_of(folder)
    assert found.n == 8
    assert set(found.setups) == {"along_x", "along_y"}
    assert rms(off_the_truth(process, found)) < NOISE_UM


def test_a_line_that_counts_in_one_go_begins_anew_where_it_was_interrupted(
    shop: tuple[SimulatedProcess, Path],
) -> None:
    """As check plans ask for: killed, and later its beam broken; what is whole is one part."""
    process, folder = shop
    plan, config, out = folder / "plan.toml", folder / "config.toml", folder / "campaign.csv"
    # one way: it is met from above, too, when it is driven back to
    write_plan(plan, line_plan("x_line", "X", [50, 250, 450], both_ways=False))
    text = plan.read_text("utf-8").replace("beyond", "in_one_go = true\nbeyond", 1)
    plan.write_text(text, "utf-8")
    with measuring(plan, config, out) as run:
        driver(process, run, folder).read(0, 1)
        os.kill(run.process.pid, signal.SIGKILL)
        run.process.wait()
    with measuring(plan, config, out) as run:
        assert run.until(lambda e: e["event"] == "resumed")["done"] == 0
        machine = driver(process, run, folder)
        machine.to(2)
        waits = run.until(lambda e: "counts in one go only" in e["text"])
        assert "anew, from target 1 of 4" in waits["text"]
        machine.read(0, 1)
        process.order("beam", broken=True)
        run.until(lambda e: e["event"] == "lost")
        process.order("beam", broken=False)
        run.until(lambda e: e["event"] == "back")
        # where it begins and ends: that is its first target now
        machine.read(0, 1, 2, 3)
        assert run.wait() == 0, run.said
    found = campaign_of(folder)
    assert found.conditions.setup is not None
    parts = [str(s) for s in found.conditions.setup]
    assert parts == ["x_line"] * 2 + ["x_line.2"] * 2 + ["x_line.3"] * 4
    # of two and two rows less their mean little is left to judge by
    assert rms(off_the_truth(process, found)) < 2.0 * NOISE_UM
    done = abbe("measure", plan, config, "-o", out, "--yes")
    assert "all 4 targets" in done.out


def test_a_full_disk_loses_nothing(shop: tuple[SimulatedProcess, Path]) -> None:
    process, folder = shop
    plan, out = write_plan(folder / "plan.toml", X_LINE), folder / "campaign.csv"
    free = resource.RLIM_INFINITY
    with measuring(plan, folder / "config.toml", out) as run:
        machine = driver(process, run, folder)
        machine.read(0, 1)
        size = out.stat().st_size
        resource.prlimit(run.process.pid, resource.RLIMIT_FSIZE, (size + 30, free))
        for number in (2, 3):
            machine.to(number)
            run.until(lambda e, n=number: e["event"] == "next" and e["done"] == n + 1)
        said = run.kinds("disk")
        assert len(said) == 1
        assert str(out) in said[0]["text"]
        assert out.stat().st_size == size
        assert len(run.kinds("row")) == 2
        resource.prlimit(run.process.pid, resource.RLIMIT_FSIZE, (free, free))
        run.rows(4)
        machine.read(*range(4, 10))
        assert run.wait() == 0, run.said
    found = campaign_of(folder)
    assert found.n == 10
    assert rms(off_the_truth(process, found)) < NOISE_UM


@pytest.mark.thorough
def test_ended_before_its_end_it_says_what_is_missing(
    shop: tuple[SimulatedProcess, Path],
) -> None:
    process, folder = shop
    plan, out = write_plan(folder / "plan.toml", X_LINE), folder / "campaign.csv"
    with measuring(plan, folder / "config.toml", out) as run:
        driver(process, run, folder).read(0, 1)
        second = abbe("measure", plan, folder / "config.toml", "-o", out, "--yes")
        assert second.status == 1
        assert "in use" in second.err
        assert run.end() == 1
    assert "targets are not measured; the same command goes on" in run.said
    assert "Traceback" not in run.said
    assert any("missing" in e["text"] for e in run.kinds("missed"))


def test_nothing_is_written_to_the_controller(shop: tuple[SimulatedProcess, Path]) -> None:
    """Every write that the wire carries would be one of Abbe's: there is none."""
    process, folder = shop
    text = (folder / "config.toml").read_text("utf-8")
    assert "[output.axes.X]" in text
    plan = write_plan(folder / "plan.toml", X_LINE)
    with measuring(plan, folder / "config.toml", folder / "campaign.csv") as run:
        driver(process, run, folder).read(0, 1, 2)
        assert process.order("written")["written"] == 0
        run.end()
    assert process.order("written")["written"] == 0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('reads = "length"', 'reads = "size"', "reads"),
        ('source = "laser.length"', 'source = "laser.no"', "has no channel"),
        ("[instrument.laser]", "[instrument.zz]", "a plan has no such instrument"),
        ("[instrument.laser]", "[instrument.indicator]", "no instrument reads set-up x_line"),
        ('unit = "mm" }\ntilt', 'unit = "K" }\ntilt', "its channel is in K"),
        ("[measure]\n", '[measure]\nactive = "gone.toml"\n', "gone.toml"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_opened(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    shutil.copy(MODEL, tmp_path / "model.toml")
    ready = {
        "host": "127.0.0.1", "port": 9, "unit": 1, "laser": "/nowhere", **_registers(),
    }  # fmt: skip
    config = configuration(ready, tmp_path, QUICK)
    text = config.read_text("utf-8")
    assert old in text
    config.write_text(text.replace(old, new, 1), "utf-8")
    plan = write_plan(tmp_path / "plan.toml", X_LINE)
    out = tmp_path / "campaign.csv"
    done = abbe("measure", plan, config, "-o", out, "--yes")
    assert done.status == 1
    assert words in done.err
    assert not out.exists()


def _registers() -> dict[str, object]:
    from abbe.drivers.simulated.bridge.registers import BLOCKS, transducer_configs

    return {
        "registers": [{"block": b.name} | r.to_dict() for b in BLOCKS for r in b.registers],
        "transducers": transducer_configs(),
    }
