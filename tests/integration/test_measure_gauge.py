"""The simulated I++ machine touches gauge blocks and step gauges: lengths, signs, faults."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.errors import AbbeError
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.gauge_file import read_gauge
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.plan_file import read_plan
from abbe.daemon.measure.probing.lying_gauge import LyingGauge
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.command_line import abbe
from tests.support.daemon.gauge_measuring import (
    ASIDE,
    BLOCK,
    STEPS,
    lay,
    places,
    plan,
    true_errors,
    write_files,
)
from tests.support.daemon.measuring import measuring, rms
from tests.support.daemon.plate_measuring import lift, machine, measured

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

NOISE_UM = 0.4
"""What may be left of a face touched three times with 0.3 µm of repeatability, µm."""


@pytest.fixture
def cmm() -> Iterator[SimulatedProcess]:
    """The machine."""
    with machine() as process:
        yield process


def off_the_truth(
    process: SimulatedProcess, folder: Path, *, sign: float = 1.0
) -> dict[str, np.ndarray]:
    """Set-up → its rows less the exact machine's errors, but for their zero, µm."""
    found = read_campaign(folder / "campaign.csv", load_model(folder / "model.toml").machine)
    c = found.conditions
    assert c.setup is not None
    assert c.u is not None
    at = np.stack([c.positions[a] for a in "XYZ"], axis=1)
    left = {}
    for name in np.unique(c.setup):
        mine = c.setup == name
        own = found.value[mine] * 1e3 - sign * true_errors(process, at[mine], c.u[mine][0])
        left[str(name)] = own - own.mean()
    return left


def test_blocks_along_axes_and_on_a_diagonal_show_the_machines_hidden_errors(
    cmm: SimulatedProcess, tmp_path: Path
) -> None:
    """Two opposite faces: the tip's diameter comes off, and the error has its sign."""
    write_files(tmp_path, cmm.ready["port"], BLOCK)
    found = places(tmp_path)
    words = [s.what for s in found]
    numbers = [next(i for i, w in enumerate(words) if f"along {a}" in w)
               for a in ("X,", "Y,", "X+ Y+", "X+ Y−")]  # fmt: skip
    setups = plan(tmp_path, *numbers)
    orders = [
        (f"set up g{i}", lambda setup=setup: lay(cmm, setup, BLOCK))
        for i, setup in enumerate(setups, start=1)
    ]
    measured(tmp_path, *orders)
    left = off_the_truth(cmm, tmp_path)
    assert list(left) == ["g1", "g2", "g3", "g4"]
    assert all(len(own) == 3 for own in left.values())
    assert rms(np.concatenate(list(left.values()))) < NOISE_UM
    wrong = off_the_truth(cmm, tmp_path, sign=-1.0)
    assert rms(np.concatenate(list(wrong.values()))) > 4.0 * NOISE_UM
    text = (tmp_path / "campaign.csv").read_text("utf-8")
    assert "2 (300.000700 mm)" in text
    fitted = abbe("compare", tmp_path / "model.toml", tmp_path / "campaign.csv")
    assert fitted.status == 0, fitted.err


@pytest.mark.thorough
def test_a_step_gauge_killed_cut_pushed_and_gone_on_with(
    cmm: SimulatedProcess, tmp_path: Path
) -> None:
    """One campaign through all of it: nothing twice, nothing lost, nothing wrong."""
    write_files(tmp_path, cmm.ready["port"], STEPS)
    setup = plan(tmp_path, 0)[0]
    lay(cmm, setup, STEPS)
    with measuring(*(tmp_path / n for n in ("plan.toml", "config.toml", "campaign.csv"))) as run:
        run.rows(2)
        os.kill(run.process.pid, signal.SIGKILL)
        run.process.wait()
        told = len(run.kinds("row"))
    kept = sum(len(own) for own in off_the_truth(cmm, tmp_path).values())
    assert told <= kept < 9
    with pytest.raises(AbbeError, match=r"connection .*not measured; the same command goes on"):
        measured(tmp_path, (".2 target", lambda: cmm.order("drop")))
    up = (ASIDE[0] + 1.5 * setup.u[0, 0, 0], ASIDE[1] + 1.5 * setup.u[0, 0, 1], ASIDE[2])
    with pytest.raises(AbbeError, match=r"face . of g1: touched 1\.\d\d mm too (early|late)"):
        measured(tmp_path, (".3 target", lambda: lay(cmm, setup, STEPS, up)))
    lay(cmm, setup, STEPS)
    with pytest.raises(AbbeError, match=r"face . of g1: nothing is touched .*1006"):
        measured(tmp_path, (".4 target", lambda: cmm.order("clean")))
    lift(cmm)
    with pytest.raises(AbbeError, match=r"the top of the gauge is not where the plan has it"):
        measured(tmp_path)
    lift(cmm)
    lay(cmm, setup, STEPS, (ASIDE[0], ASIDE[1], 2.6))
    with pytest.raises(AbbeError, match=r"the gauge lies .* mm off the plan at face"):
        measured(tmp_path)
    lay(cmm, setup, STEPS)
    measured(tmp_path)
    left = off_the_truth(cmm, tmp_path)
    assert sum(len(own) for own in left.values()) == 9  # eight faces and the first again
    assert rms(np.concatenate(list(left.values()))) < NOISE_UM
    assert cmm.order("report")["clients"] == 0


def test_abbe_plan_plans_places_of_the_gauge_at_hand(tmp_path: Path) -> None:
    """What it plans is what `abbe measure` takes: across the stylus, faces where they are."""
    write_files(tmp_path, 1, BLOCK)
    done = abbe("plan", tmp_path / "model.toml", "--instruments", "gauge-block", "--gauge",
                tmp_path / "gauge.csv", "--tool", "P=0,0,-150", "--time", "40min",
                "-o", tmp_path / "plan.toml")  # fmt: skip
    assert done.status == 0, done.err
    setups = read_plan(tmp_path / "plan.toml", load_model(tmp_path / "model.toml").machine).setups
    assert len(setups) > 1
    gauge = read_gauge(tmp_path / "gauge.csv")
    for setup in setups:
        assert "gauge of 300 mm" in setup.what
        lies = LyingGauge.planned(gauge, setup, (0.0, 0.0, 1.0))
        assert np.allclose(lies.place(BLOCK[1]), setup.path()[1], atol=0.01)
    refused = abbe("program", tmp_path / "plan.toml", "--controller", "ipp", "-o",
                   tmp_path / "p.txt")  # fmt: skip
    assert refused.status == 1
    assert "abbe measure" in refused.err


def test_what_the_tip_finds_no_room_for_and_another_gauge_are_refused(
    cmm: SimulatedProcess, tmp_path: Path
) -> None:
    write_files(tmp_path, cmm.ready["port"], STEPS)
    plan(tmp_path, 0)
    config = tmp_path / "config.toml"
    text = config.read_text("utf-8")
    for key, value, named in (
        ("approach", 40.0, r"probing\.approach.*40.*less than"),
        ("clearance", 20.0, r"probing\.clearance.*20.*more than"),
        ("placing", 7.8, r"probing\.placing.*found 7\.8, expected less than 10 mm for both"),
        ("tip", 38.0, r"probing\.placing.* 19\.5 mm for the tip.*less than 10 mm for both"),
    ):
        lines = [own for own in text.splitlines() if not own.startswith(f"{key} =")]
        config.write_text("\n".join([*lines, f"{key} = {value}\n"]), encoding="utf-8")
        with pytest.raises(AbbeError, match=rf"config\.toml.*{named}"):
            measured(tmp_path)
        assert not (tmp_path / "campaign.csv").exists()
    config.write_text(text, encoding="utf-8")
    gauge = tmp_path / "gauge.csv"
    gauge.write_text(gauge.read_text("utf-8").replace("60.0011", "61.0011"), encoding="utf-8")
    with pytest.raises(AbbeError, match="was not planned for this gauge"):
        measured(tmp_path)
    assert not (tmp_path / "campaign.csv").exists()
    moved = cmm.order("report")["commands"]
    assert not [c for c in moved if c.startswith(("GoTo", "PtMeas"))]
