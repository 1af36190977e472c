"""The simulated I++ machine touches a ball plate by itself: its hidden errors, and faults."""

from __future__ import annotations

import csv
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.artefacts.plate import rigid_placing
from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import AbbeError
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.plate_file import read_plate
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.model import Model
from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups.plates import probed_plates
from abbe.compcore.planning.targets import SurveyTask
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.command_line import abbe
from tests.support.daemon.measuring import measuring, rms
from tests.support.daemon.plate_measuring import (
    exact,
    lay,
    machine,
    measured,
    plan_text,
    put_back,
    write_files,
)

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

NOISE_UM = 0.5
"""What may be left of a ball's middle of five touches of 0.3 µm of repeatability each, µm."""
PLACES = (0, 5, 6, 11, 14, 17, 24, 29, 31, 34, 36, 41, 43, 46)
"""Of the placings that can be planned, those of the long test."""
EFFECTS = "".join(
    f'[[effects]]\nkind = "positioning"\naxis = "{a}"\nshape = "polynomial:5"\n'
    f'[[effects]]\nkind = "scale_expansion"\naxis = "{a}"\nsignals = ["T_{a.lower()}"]\n'
    for a in "XYZ"
) + "".join(
    f'[[effects]]\nkind = "straightness"\naxis = "{a}"\ndirection = "{d}"\n'
    'shape = "polynomial:5"\n'
    for a in "XYZ" for d in "XYZ" if d != a
) + "".join(
    f'[[effects]]\nkind = "angular"\naxis = "{a}"\nabout = "{d}"\nshape = "polynomial:5"\n'
    for a in "XYZ" for d in "XYZ"
) + "".join(
    f'[[effects]]\nkind = "squareness"\naxes = {pair}\n'
    for pair in ('["Y", "X"]', '["X", "Z"]', '["Y", "Z"]')
)  # fmt: skip


def possible(folder: Path) -> list[PlannedSetup]:
    """All places where the plate can lie."""
    task = SurveyTask(load_model(folder / "model.toml"), tools={"P": (0.0, 0.0, -150.0)})
    return list(probed_plates(task, INSTRUMENTS["ball-plate"], read_plate(folder / "plate.csv")))


def placings(folder: Path, *numbers: int) -> list[str]:
    """A plan of some of these places; their names."""
    found = possible(folder)
    chosen = [found[i] for i in numbers]
    (folder / "plan.toml").write_text(plan_text(chosen), encoding="utf-8")
    return [f"p{i}" for i in range(1, len(chosen) + 1)]


@pytest.fixture
def small(tmp_path: Path) -> Iterator[tuple[SimulatedProcess, Path]]:
    """Nine balls that lie flat, and the machine."""
    with machine() as process:
        write_files(tmp_path, process.ready["port"], 3, 60.0)
        placings(tmp_path, 0)
        lay(process, tmp_path, "p1")
        yield process, tmp_path


def campaign_text(folder: Path) -> str:
    return (folder / "campaign.csv").read_text("utf-8")


def campaign_of(folder: Path) -> Campaign:
    return read_campaign(folder / "campaign.csv", load_model(folder / "model.toml").machine)


def off_the_truth(process: SimulatedProcess, folder: Path) -> np.ndarray:
    """Rows less the exact machine's errors, each set-up but for its frame, µm, (balls, 3)."""
    found = campaign_of(folder)
    c = found.conditions
    assert c.setup is not None
    assert c.u is not None
    at = np.stack([c.positions[a] for a in "XYZ"], axis=1)[::3]
    truth = exact(process, at)["errors"]
    shown = np.einsum("nk,nki->ni", found.value.reshape(-1, 3), c.u.reshape(-1, 3, 3))
    left = np.zeros_like(at)
    for name in np.unique(c.setup):
        mine = c.setup[::3] == name
        # what a small displacement of the plate cannot explain
        turn, shift = rigid_placing((at + truth)[mine], (at + shown)[mine])
        left[mine] = (at + shown)[mine] - ((at + truth)[mine] @ turn.T + shift)
    return left * 1e3


@pytest.mark.thorough
def test_a_plate_in_several_places_shows_the_machines_hidden_errors(tmp_path: Path) -> None:
    """Placings touched, fitted; judged by the exact machine, also where the plate never lay."""
    with machine() as process:
        write_files(tmp_path, process.ready["port"], 3, 130.0, EFFECTS)
        names = placings(tmp_path, *PLACES)
        orders = [(f"set up {n}", lambda n=n: lay(process, tmp_path, n)) for n in names]
        measured(tmp_path, *orders)
        # on ways it comes no nearer than half of where touches begin: 3 mm
        assert 1.4 < process.order("report")["nearest_way"] < 3.1
        assert rms(off_the_truth(process, tmp_path)) < NOISE_UM
        found = campaign_of(tmp_path)
        assert found.n == len(PLACES) * 10 * 3
        assert set(found.conditions.signals) >= {"T_x", "T_y", "T_z", "T_part"}
        fitted = abbe("fit", tmp_path / "model.toml", tmp_path / "campaign.csv", "-o",
                      tmp_path / "fitted.toml")  # fmt: skip
        assert fitted.status == 0, fitted.err
        warm = exact(process, [[350.0, 450.0, -180.0]])["temperatures"]
        unseen = [path_of(s) for i, s in enumerate(possible(tmp_path)) if i not in PLACES]
        ends = [np.triu_indices(len(at), 1) for at in unseen]
        truth = [exact(process, at)["errors"] for at in unseen]
    model = load_model(tmp_path / "fitted.toml")
    lengths = [length_errors(at, e, k) for at, e, k in zip(unseen, truth, ends, strict=True)]
    left = [
        length_errors(at, e - predicted(model, at, warm), k)
        for at, e, k in zip(unseen, truth, ends, strict=True)
    ]
    before, after = rms(np.concatenate(lengths)), rms(np.concatenate(left))
    assert before > 5.0
    assert after < before / 4.0, (before, after)


def path_of(setup: PlannedSetup) -> np.ndarray:
    """Axes' positions at a set-up's targets, mm, (n, 3)."""
    return np.stack([setup.targets[a] for a in "XYZ"], axis=1)


def length_errors(
    at: np.ndarray, errors: np.ndarray, ends: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """By how much distances between places (n, 3) are wrong, µm."""
    way = at[ends[0]] - at[ends[1]]
    along = way / np.linalg.norm(way, axis=1)[:, None]
    return 1e3 * np.einsum("ni,ni->n", along, errors[ends[0]] - errors[ends[1]])


def predicted(model: Model, at: np.ndarray, warm: np.ndarray) -> np.ndarray:
    """What a model says at axes' positions with the machine's temperatures, mm, (n, 3)."""
    n = len(at)
    signals = {f"T_{a}": np.full(n, warm[2 * k : 2 * k + 2].mean()) for k, a in enumerate("xyz")}
    conditions = Conditions(
        {a: at[:, k] for k, a in enumerate("XYZ")}, tool=np.tile([0.0, 0.0, -150.0], (n, 1)),
        signals=signals | {"T_part": np.full(n, warm[-1])},
    )  # fmt: skip
    return model.predict(conditions).translation


@pytest.mark.thorough
def test_killed_cut_stopped_a_thermometer_and_a_ball_lost_nothing_wrong_is_kept(
    small: tuple[SimulatedProcess, Path],
) -> None:
    """One campaign through all of it; whatever ended it, the same command goes on."""
    process, folder = small
    with measuring(*(folder / n for n in ("plan.toml", "config.toml", "campaign.csv"))) as run:
        run.rows(2)
        os.kill(run.process.pid, signal.SIGKILL)
        run.process.wait()
        told = len(run.kinds("row"))
    kept = campaign_of(folder).n // 3
    assert told <= kept < 9
    # somebody has moved it meanwhile: away from the tip, which may stand close to a ball
    lay(process, folder, "p1", aside=(0.0, 0.0, -1.0))
    with pytest.raises(AbbeError, match=r"connection .*not measured; the same command goes on"):
        measured(
            folder,
            (".2 target", lambda: process.order("thermistors", lost=1)),
            ("waits: T_x", lambda: process.order("thermistors", lost=0)),
            (".2 target", lambda: process.order("drop")),
        )
    emergency = {"severity": 3, "number": 2500, "text": "Emergency stop", "unasked": True}
    with pytest.raises(AbbeError, match="514|Emergency"):
        measured(folder, (".3 target", lambda: process.order("error", **emergency)))
    process.order("gone", ball=7)
    with pytest.raises(AbbeError, match=r"ball 8 of p1: nothing is touched .*1006"):
        measured(folder)
    config = folder / "config.toml"
    text = config.read_text("utf-8")
    config.write_text(text + 'missed = "leave out"\n', encoding="utf-8")
    with pytest.raises(AbbeError, match="was begun with another configuration"):
        measured(folder)
    config.write_text(text, encoding="utf-8")
    put_back(process, 7)
    measured(folder)
    found = campaign_of(folder)
    assert found.n == 30  # nine balls and the first again
    # a stop that comes before the first row of a set-up leaves none of its name
    names = ["p1", "p1.2", "p1.3", "p1.4", "p1.5"]
    assert set(found.setups) in (set(names), set(names[:-1]))
    assert rms(off_the_truth(process, folder)) < NOISE_UM
    assert process.order("report")["clients"] == 0


def test_a_ball_that_is_not_there_is_left_out_where_that_is_wanted(
    small: tuple[SimulatedProcess, Path],
) -> None:
    process, folder = small
    config = folder / "config.toml"
    config.write_text(config.read_text("utf-8") + 'missed = "leave out"\n', encoding="utf-8")
    process.order("gone", ball=4)
    with pytest.raises(AbbeError, match="1 of 10 targets is not measured"):
        measured(folder)
    assert campaign_of(folder).n == 27
    text = (folder / "campaign.csv").read_text("utf-8")
    rows = [*csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))]
    # mm/s, as the configuration orders it
    assert {row["touch_speed"] for row in rows} == {"3"}
    assert "feed" not in rows[0]
    assert rms(off_the_truth(process, folder)) < NOISE_UM


def test_what_lies_elsewhere_another_tool_and_a_way_that_is_not_free_are_refused(
    small: tuple[SimulatedProcess, Path],
) -> None:
    process, folder = small
    plan = folder / "plan.toml"
    lay(process, folder, "p1", aside=(0.0, 0.0, 6.0))
    with pytest.raises(AbbeError, match=r"the plate lies .* off the plan at ball"):
        measured(folder)
    lay(process, folder, "p1", aside=(0.0, 0.0, 25.0))
    with pytest.raises(AbbeError, match="2504 .*Collision"):
        measured(folder)
    assert campaign_text(folder).count("\np1,") == 0
    text = plan.read_text("utf-8")
    (folder / "campaign.csv").unlink()
    plan.write_text(text.replace("-150.0]", "-149.0]"), encoding="utf-8")
    with pytest.raises(AbbeError, match="the tip is 1.00 mm from where"):
        measured(folder)
    box = "[[keep_out]]\nlow = [0.0, 0.0, -600.0]\nhigh = [30.0, 900.0, -400.0]\n\n[[setups]]"
    plan.write_text(text.replace("[[setups]]", box, 1), encoding="utf-8")
    (folder / "campaign.csv").unlink()
    before = process.order("report")["commands"]
    with pytest.raises(AbbeError, match="keep-out box 1"):
        measured(folder)
    moved = process.order("report")["commands"][len(before) :]
    assert not [c for c in moved if c.startswith(("GoTo", "PtMeas"))]
