"""``abbe measure`` on a real LinuxCNC that touches a sphere and a block by itself, by G38.2."""

from __future__ import annotations

import os
import signal
import tomllib
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import AbbeError
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from tests.support.daemon.command_line import abbe
from tests.support.daemon.measuring import measuring, rms
from tests.support.daemon.plate_measuring import measured
from tests.support.drivers.linuxcnc import artefact
from tests.support.drivers.linuxcnc.touched_campaign import (
    LATE_UM,
    sphere_errors,
    write_block,
    write_sphere,
)
from tests.support.drivers.linuxcnc.touching_mill import TIP, TOOL, TouchingMill, says

pytestmark = [pytest.mark.integration, pytest.mark.calibration, pytest.mark.timeout(900)]

ANGLES = (-130.0, -20.0, 35.0, 150.0)
DIAMETER = 25.0


def rows_of(folder: Path) -> Campaign:
    machine = load_model(folder / "model.toml").machine
    return read_campaign(folder / "campaign.csv", machine)


def off_the_truth(folder: Path) -> np.ndarray:
    """Rows less what they have to be, each set-up but for how its sphere stands, µm, (n, 3)."""
    c = rows_of(folder)
    angles = np.degrees(c.conditions.positions["C"][::3])
    setups = c.conditions.setup
    assert setups is not None
    left = 1e3 * (c.value.reshape(-1, 3) - sphere_errors(angles))
    for name in np.unique(setups):
        mine = setups[::3] == name
        s, c_ = np.sin(np.radians(angles[mine])), np.cos(np.radians(angles[mine]))
        turned = np.zeros((3 * mine.sum(), 3))
        turned[0::3] = np.stack([c_, s, 0.0 * s], axis=1)
        turned[1::3] = np.stack([-s, c_, 0.0 * s], axis=1)
        turned[2::3, 2] = 1.0
        place, *_ = np.linalg.lstsq(turned, left[mine].ravel(), rcond=None)
        left[mine] -= (turned @ place).reshape(-1, 3)
    return left


def test_a_sphere_on_its_table_through_all_that_may_happen(tmp_path: Path) -> None:
    """Abort, machine off, Abbe killed, a silent probe, a pushed sphere: one campaign, all true."""
    with TouchingMill(DIAMETER) as mill:
        write_sphere(tmp_path, ANGLES, DIAMETER)
        with measuring(
            *(tmp_path / n for n in ("plan.toml", "config.toml", "campaign.csv"))
        ) as run:
            run.rows(2)
            os.kill(run.process.pid, signal.SIGKILL)
            run.process.wait()
        kept = (tmp_path / "campaign.csv").read_bytes()
        stopped = r"somebody else has told LinuxCNC something; .* the same command goes on"
        with pytest.raises(AbbeError, match=stopped):
            measured(tmp_path, (".2 target", lambda: mill.order("abort")))
        with pytest.raises(AbbeError, match=r"switched off|somebody else|status word"):
            measured(tmp_path, (".3 target", lambda: mill.order("off")))
        with pytest.raises(AbbeError, match=r"machine is off|no position"):
            measured(tmp_path)
        assert mill.order("on") == []
        with pytest.raises(AbbeError, match=r"of s1 at C .*: nothing is touched .*G38.2"):
            measured(tmp_path, (".4 target", lambda: mill.hal("works.in1", 0)))
        with pytest.raises(AbbeError, match="is not where the plan has it: nothing is touched"):
            measured(tmp_path)
        # it stands where its search ended: within the sphere
        mill.order("mdi", "G21 G90 G53 G1 F9000 Z0")
        mill.hal("works.in1", 1)
        with pytest.raises(AbbeError, match=r"of s1 at C .*: touched .* mm too (early|late)"):
            measured(tmp_path, (".5 target", lambda: mill.hal("from-z.offset", TOOL[2] - 0.8)))
        mill.hal("from-z.offset", TOOL[2])
        assert mill.order("mdi", "G21 G43.1 Z97") == []
        with pytest.raises(AbbeError, match=r"the tip is 3\.00 mm from where .* another tool"):
            measured(tmp_path)
        mill.take_stylus()
        measured(tmp_path)
    c = rows_of(tmp_path)
    assert (tmp_path / "campaign.csv").read_bytes().splitlines()[-1] != kept.splitlines()[-1]
    angles = np.degrees(c.conditions.positions["C"][::3])
    assert sorted(angles.round(3).tolist()) == sorted([*ANGLES, *ANGLES])
    assert rms(1e3 * sphere_errors(angles)) > 20.0
    left = off_the_truth(tmp_path)
    print(f"rows within {rms(left):.2f} µm (rms) of the truth")
    assert rms(left) < LATE_UM
    fitted = abbe("fit", tmp_path / "model.toml", tmp_path / "campaign.csv", "-o",
                  tmp_path / "fitted.toml")  # fmt: skip
    assert fitted.status == 0, fitted.err
    effect = tomllib.loads((tmp_path / "fitted.toml").read_text("utf-8"))["effects"][0]
    found = {name: one["value"] for name, one in effect["parameters"].items()}
    # where the machine says that the table's line is, less where it is believed to be
    middle = np.array([*artefact.LINE[:2], artefact.START[2]])
    own = middle - says(middle[None, :])[0]
    assert found["E_X0C"] == pytest.approx(own[0] - artefact.BESIDE[0], abs=0.012)
    assert found["E_Y0C"] == pytest.approx(own[1] - artefact.BESIDE[1], abs=0.012)


def test_a_block_planned_for_and_touched_as_the_page_says(tmp_path: Path) -> None:
    """`abbe plan`, `abbe measure`: a block that lies askew shows the machine's own errors."""
    size = (220.0003, 30.0, 24.0)
    write_block(tmp_path, (0.0, size[0]), size[1:])
    plan, config, out = (tmp_path / n for n in ("plan.toml", "config.toml", "campaign.csv"))
    done = abbe("plan", tmp_path / "model.toml", "--instruments", "gauge-block", "--gauge",
                tmp_path / "gauge.csv", "--tool", "P=0,0,-100", "--time", "40min", "-o",
                plan)  # fmt: skip
    assert done.status == 0, done.err
    setup = tomllib.loads(plan.read_text("utf-8"))["setups"][0]
    first, last = (np.array(target[-3:]) + TOOL for target in setup["targets"])
    with TouchingMill() as mill:
        way = (last - first) / np.linalg.norm(last - first)
        angle = float(np.arctan2(way[1], way[0])) + 0.004
        along = np.array([np.cos(angle), np.sin(angle), 0.0])
        middle = first + 0.5 * size[0] * along + (0.7, -0.5, 0.6)
        mill.lay(middle, angle, size)
        done = abbe("measure", plan, config, "-o", out, "--setup", setup["name"], "--yes")
        assert done.status == 0, done.err
    ends = middle + 0.5 * np.array([[-1.0], [1.0]]) * (size[0] + TIP) * along
    indicated = says(ends)
    shows = size[0] + TIP - float((indicated[1] - indicated[0]) @ along)
    found = rows_of(tmp_path).value
    assert abs(shows) > 5e-3
    # each face is seen late by up to LATE_UM: the tip seems to be smaller by both
    assert -0.5e-3 < (found[1] - found[0]) - shows < 2.0e-3 * LATE_UM + 0.5e-3
