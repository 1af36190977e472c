"""The simulated I++ machine touches a sphere that its rotary table turns: truth, signs, faults."""

from __future__ import annotations

import os
import signal
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.errors import AbbeError
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.command_line import abbe
from tests.support.daemon.measuring import measuring, rms
from tests.support.daemon.plate_measuring import exact, machine, measured, put_back
from tests.support.daemon.sphere_measuring import (
    ASIDE,
    BESIDE,
    LINE,
    planned,
    push,
    stand,
    true_errors,
    write_files,
)

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

ANGLES = (-135.0, -80.0, -30.0, 25.0, 80.0, 140.0)
NOISE_UM = 0.5
"""What may be left of a sphere's middle of five touches of 0.3 µm of repeatability each, µm."""
LOCATION = '[[effects]]\nkind = "rotary_location"\naxis = "C"\n'


@pytest.fixture
def table(tmp_path: Path) -> Iterator[tuple[SimulatedProcess, Path]]:
    """A sphere on the rotary table, and the machine."""
    with machine() as process:
        write_files(tmp_path, process.ready["port"], ANGLES, LOCATION)
        stand(process, tmp_path)
        yield process, tmp_path


def shown(folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles (degrees), errors in machine axes (n, 3) µm, and set-ups of the campaign's visits."""
    found = read_campaign(folder / "campaign.csv", load_model(folder / "model.toml").machine)
    c = found.conditions
    assert c.setup is not None
    values = found.value.reshape(-1, 3) * 1e3
    return np.degrees(c.positions["C"][::3]), values, c.setup[::3]


def off_the_truth(process: SimulatedProcess, folder: Path) -> np.ndarray:
    """Rows less what they have to be, each set-up but for how its sphere stands, µm, (n, 3)."""
    angles, values, setups = shown(folder)
    left = values - 1e3 * true_errors(process, folder, angles)
    for name in np.unique(setups):
        mine = setups == name
        # where the sphere stands on the table is free: a place that turns with the table
        turned = np.concatenate([_with_table(a) for a in angles[mine]])
        place, *_ = np.linalg.lstsq(turned, left[mine].ravel(), rcond=None)
        left[mine] -= (turned @ place).reshape(-1, 3)
    return left


def _with_table(angle: float) -> np.ndarray:
    s, c = np.sin(np.radians(angle)), np.cos(np.radians(angle))
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def test_a_sphere_at_several_angles_shows_where_the_table_really_turns(
    table: tuple[SimulatedProcess, Path],
) -> None:
    """Row by row against exact machine and table; then the line by `abbe fit`, with its sign."""
    process, folder = table
    measured(folder)
    angles, values, _ = shown(folder)
    assert len(angles) == 2 * len(ANGLES)
    assert np.allclose(angles, [*ANGLES, *ANGLES[::-1]], atol=1e-6)
    assert rms(values) > 20.0
    assert rms(off_the_truth(process, folder)) < NOISE_UM
    # a row with the other sign, or of the other direction of turning, would be far off
    wrong = values + 1e3 * true_errors(process, folder, angles)
    assert rms(wrong - wrong.mean(axis=0)) > 20.0
    text = (folder / "campaign.csv").read_text("utf-8")
    assert "form" in text
    came = read_campaign(folder / "campaign.csv", load_model(folder / "model.toml").machine)
    assert came.conditions.directions["C"][::3].tolist() == [1.0] * 6 + [-1.0] * 6
    fitted = abbe("fit", folder / "model.toml", folder / "campaign.csv", "-o", folder / "f.toml")
    assert fitted.status == 0, fitted.err
    effect = tomllib.loads((folder / "f.toml").read_text("utf-8"))["effects"][0]
    found = {name: one["value"] for name, one in effect["parameters"].items()}
    # a table's line counts with the other sign (ISO 230-7 as Abbe takes it), and is seen from where
    # the machine's own error puts the tip
    own = exact(process, [[*LINE, planned(folder).targets["Z"][0]]])["errors"][0]
    assert found["E_X0C"] == pytest.approx(own[0] - BESIDE[0], abs=5e-3)
    assert found["E_Y0C"] == pytest.approx(own[1] - BESIDE[1], abs=5e-3)


def test_killed_cut_stuck_lost_and_gone_on_with(table: tuple[SimulatedProcess, Path]) -> None:
    """One campaign through all of it: nothing twice, nothing lost, nothing wrong."""
    process, folder = table
    with measuring(*(folder / n for n in ("plan.toml", "config.toml", "campaign.csv"))) as run:
        run.rows(2)
        os.kill(run.process.pid, signal.SIGKILL)
        run.process.wait()
        told = len(run.kinds("row"))
    kept = len(shown(folder)[0])
    assert told <= kept < 12
    with pytest.raises(AbbeError, match=r"connection .*not measured; the same command goes on"):
        measured(folder, (".2 target", lambda: process.order("drop")))
    nothing = r"of s1 at C .*: nothing is touched .*1006"
    with pytest.raises(AbbeError, match=nothing):
        measured(folder, (".3 target", lambda: process.order("gone", ball=0)))
    with pytest.raises(AbbeError, match="is not where the plan has it: nothing is touched"):
        measured(folder)
    put_back(process, 0)
    low, high = ((ASIDE[0], ASIDE[1], ASIDE[2] + by) for by in (-1.2, 1.2))
    with pytest.raises(AbbeError, match=r"of s1 at C .*: touched 1\.\d\d mm too late"):
        measured(folder, (".4 target", lambda: push(process, folder, low)))
    put_back(process, 0)
    with pytest.raises(AbbeError, match=r"of s1 at C .*: touched .* mm too early"):
        measured(folder, (".5 target", lambda: push(process, folder, high)))
    put_back(process, 0)
    stand(process, folder)
    with pytest.raises(AbbeError, match=r"C stands at .*° and was sent to"):
        measured(folder, (".6 target", lambda: process.order("stuck")))
    stand(process, folder)
    measured(folder)
    angles, _, setups = shown(folder)
    assert sorted(angles.round(6).tolist()) == sorted([*ANGLES, *ANGLES])
    assert set(setups) <= {"s1", *(f"s1.{k}" for k in range(2, 10))}
    assert rms(off_the_truth(process, folder)) < NOISE_UM
    assert process.order("report")["clients"] == 0


def test_a_sphere_elsewhere_and_a_table_that_the_link_does_not_turn_are_refused(
    table: tuple[SimulatedProcess, Path],
) -> None:
    process, folder = table
    stand(process, folder, aside=(0.0, 0.0, 6.0))
    with pytest.raises(AbbeError, match=r"the sphere (stands|is not)"):
        measured(folder)
    assert ",s1," not in (folder / "campaign.csv").read_text("utf-8")
    (folder / "campaign.csv").unlink()
    config = folder / "config.toml"
    text = config.read_text("utf-8")
    config.write_text(text.replace('axis = "R"', 'axis = "Tool.A"'), encoding="utf-8")
    before = process.order("report")["commands"]
    with pytest.raises(AbbeError, match="set-up s1 turns C, and link cmm does not"):
        measured(folder)
    moved = process.order("report")["commands"][len(before) :]
    assert not [c for c in moved if c.startswith(("GoTo", "PtMeas"))]
