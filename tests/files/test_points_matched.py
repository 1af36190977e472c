"""A tracker's own file of points, matched with the poses that an arm was followed to."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.files.campaign_csv.writing import as_cell
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.growing_campaign import top_of
from abbe.compcore.files.importers.points_matched import reads_points, write_points
from abbe.compcore.files.model_file import save_model
from abbe.compcore.files.visited_targets import IN_A_FILE, READINGS, VisitedTargets
from abbe.compcore.model.model import Model
from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups.poses import poses
from abbe.compcore.planning.targets import SurveyTask
from abbe.daemon.commands.calibration.files_matched import match_readings
from abbe.daemon.measure.rows import columns, head, rows_of
from tests.support.compcore.arm_points import JOINTS, arm, tips

TOOL = (980.0, 30.0, 1350.0)
WRONG = np.zeros((6, 6))
WRONG[2] = (0.1, -0.2, 0.05, 2e-4, -1e-4, 3e-4)
WRONG[4] = (-0.1, 0.1, 0.2, 1e-4, 4e-4, -2e-4)
"""How two of the joints lie, mm and rad."""


def visited(
    folder: Path, instrument: str, alone: str = ""
) -> tuple[VisitedTargets, PlannedSetup, np.ndarray]:
    """The rows of a set-up that was followed, and where the reflector was at each visit, mm."""
    machine = arm()
    task = SurveyTask(Model(machine), tools={"F": TOOL})
    made = next(poses(task, INSTRUMENTS[instrument], {"in front": 0.0}, 30, some=False))
    still = {a: np.full_like(v, v[0]) for a, v in made.targets.items() if alone not in ("", a)}
    setup = replace(made, name="s1", targets={**made.targets, **still})
    order, _ = setup.visits()
    senses = setup.senses()
    q = np.stack([setup.targets[joint][order] for joint in JOINTS], axis=1)
    rows = [
        row
        for k, target in enumerate(order.tolist())
        for row in rows_of(
            setup, 0, target, dict(zip(JOINTS, q[k].tolist(), strict=True)),
            [math.nan] * setup.u.shape[1], {j: float(senses[j][k]) for j in JOINTS},
            10.0 * k, [0.02] * setup.u.shape[1], {}, {},
        )
    ]  # fmt: skip
    names = columns(machine, [setup], [])
    begun = {READINGS: IN_A_FILE}
    top = top_of(head(machine, [setup], {}, begun, datetime(2026, 3, 2, tzinfo=UTC)), names)
    lines = [",".join(as_cell(row.get(name)) for name in names) for row in rows]
    path = folder / "visits.csv"
    path.write_text(top + "\n".join(lines) + "\n", encoding="utf-8")
    (found,) = VisitedTargets.read_all(path)
    return found, setup, tips(q, np.tile(TOOL, (len(q), 1)), WRONG)


def write(folder: Path, names: str, values: np.ndarray) -> Path:
    file = folder / "points.csv"
    lines = [",".join(f"{v:.6f}" for v in row) for row in values]
    file.write_text("\n".join([names, *lines]) + "\n", encoding="utf-8")
    return file


def in_its_frame(points: np.ndarray) -> np.ndarray:
    turn = Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()
    return points @ turn.T + [1500.0, -300.0, 800.0]


def test_points_become_the_errors_of_the_poses_but_for_the_frame(tmp_path):
    visits, setup, actual = visited(tmp_path, "laser-tracker")
    assert reads_points(visits)
    file = write(tmp_path, "x,y,z", in_its_frame(actual))
    count, notes = write_points([(file, visits)], arm(), tmp_path / "campaign.csv")
    assert count == 3 * len(actual)
    assert len(notes) == 1
    found = read_campaign(tmp_path / "campaign.csv", arm())
    assert found.setups["s1"].free == ("frame",)
    order, _ = setup.visits()
    q = np.stack([setup.targets[joint][order] for joint in JOINTS], axis=1)
    nominal = tips(q, np.tile(TOOL, (len(q), 1)))
    error = actual - nominal
    # who stands somewhere sees all but a shift and a turn of everything
    about = np.zeros((len(q), 3, 6))
    about[:, :, :3] = np.eye(3)
    for k, axis in enumerate(np.eye(3)):
        about[:, :, 3 + k] = np.cross(axis, nominal)
    design = about.reshape(-1, 6)
    left = [
        v - design @ np.linalg.lstsq(design, v, rcond=None)[0]
        for v in (error.reshape(-1), found.value)
    ]
    assert np.abs(left[0]).max() > 0.1
    assert np.abs(left[0] - left[1]).max() < 2e-3
    assert np.allclose(found.conditions.tool, TOOL)


def test_distances_are_taken_as_they_are(tmp_path):
    visits, setup, actual = visited(tmp_path, "tracker")
    far = np.linalg.norm(actual - np.array(setup.base) - [2.0, -1.0, 3.0], axis=1) + 40.0
    file = write(tmp_path, "distance", far[:, None])
    write_points([(file, visits)], arm(), tmp_path / "campaign.csv")
    assert np.allclose(read_campaign(tmp_path / "campaign.csv", arm()).value, far, atol=1e-5)
    with pytest.raises(InputError, match="not those of the poses"):
        write_points(
            [(write(tmp_path, "distance", far[::-1, None]), visits)], arm(), tmp_path / "n"
        )


def test_a_calibration_asks_for_the_file_and_matches_it(tmp_path):
    visits, _, actual = visited(tmp_path, "laser-tracker")
    save_model(Model(arm()), tmp_path / "model.toml")
    said: list[str] = []

    def match() -> None:
        match_readings(visits.path, tmp_path / "model.toml", tmp_path / "readings",
                       tmp_path / "campaign.csv", said.append, None)  # fmt: skip

    with pytest.raises(AbbeError, match="one line for each pose"):
        match()
    write(tmp_path, "x,y,z", in_its_frame(actual)).rename(tmp_path / "readings" / "s1.csv")
    match()
    assert "93 readings of 1 file matched" in said[-1]
    assert read_campaign(tmp_path / "campaign.csv", arm()).n == 93


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda p: p[:-1], "30 readings, and the machine stood at 31 poses"),
        (lambda p: np.roll(p, 1, axis=0), "not those of the poses"),
        (lambda p: p * 25.4, "not those of the poses"),
        (lambda p: p * [1.0, 1.0, -1.0], "not those of the poses"),
    ],
)
def test_points_that_do_not_fit_are_refused_and_nothing_is_written(tmp_path, change, says):
    visits, _, actual = visited(tmp_path, "laser-tracker")
    file = write(tmp_path, "x,y,z", change(in_its_frame(actual)))
    with pytest.raises(InputError, match=says):
        write_points([(file, visits)], arm(), tmp_path / "campaign.csv")
    assert not (tmp_path / "campaign.csv").exists()


def test_single_readings_of_other_poses_are_named(tmp_path):
    """Typed: two of 201 points exchanged passed, as they hardly count in the rms of all."""
    visits, _, actual = visited(tmp_path, "laser-tracker")
    for elsewhere in (12.0, 60.0):
        points = in_its_frame(actual)
        points[7] = points[7] + [elsewhere, 0.0, 0.0]
        file = write(tmp_path, "x,y,z", points)
        with pytest.raises(InputError, match=r"single readings.*reading 8 \(") as caught:
            write_points([(file, visits)], arm(), tmp_path / "campaign.csv")
        assert "reading 9" not in str(caught.value)
        assert not (tmp_path / "campaign.csv").exists()


def test_one_joint_alone_says_nothing_of_where_the_reflector_is(tmp_path):
    visits, _, actual = visited(tmp_path, "laser-tracker", "C1")
    file = write(tmp_path, "x,y,z", in_its_frame(actual))
    write_points([(file, visits)], arm(), tmp_path / "campaign.csv")
    assert np.allclose(read_campaign(tmp_path / "campaign.csv", arm()).conditions.tool, TOOL)


def test_a_reflector_mm_elsewhere_is_taken_from_where_it_is(tmp_path):
    visits, setup, _ = visited(tmp_path, "laser-tracker")
    order, _ = setup.visits()
    q = np.stack([setup.targets[joint][order] for joint in JOINTS], axis=1)
    there = np.add(TOOL, (0.0, 12.0, 5.0))
    file = write(tmp_path, "x,y,z", in_its_frame(tips(q, np.tile(there, (len(q), 1)))))
    _, notes = write_points([(file, visits)], arm(), tmp_path / "campaign.csv")
    assert "not where the plan has it: 980, 42, 1355 mm" in notes[1]
    found = read_campaign(tmp_path / "campaign.csv", arm())
    assert np.abs(found.value).max() < 2e-3
