"""A tracker's points to a campaign: its stand and the reflector are found, errors are left."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_file import read_campaign, write_campaign
from abbe.compcore.files.importers.placing import ForeignPlacing
from abbe.compcore.files.importers.tracker import import_points
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

ARM = "C1 0 0 -800, B2 80 0 -800, B3 80 0 -200, A4 0 0 0, B5 0 0 0"
TOOL = np.array([310.0, -20.0, 45.0])
STAND = Rotation.from_rotvec([0.3, -0.2, 2.1])
SHIFT = np.array([3600.0, -1200.0, 400.0])


def machine(structure: str, lines: str = "") -> Machine:
    text = f'format = "abbe-model/1"\n[machine]\nname = "M"\nstructure = "{structure}"\n'
    for line in filter(None, lines.split(", ")):
        axis, *at = line.split()
        place = ", ".join(f"{float(v)}" for v in at)
        text += f"[machine.axes.{axis}]\ntravel = [-180.0, 180.0]\nlocation = [{place}]\n"
    for axis in "" if lines else "XYZ":
        text += f"[machine.axes.{axis}]\ntravel = [-1000.0, 1000.0]\n"
    return parse_model(TomlSource(text)).machine


def reached(angles: F64, tool: F64) -> F64:
    """Where the arm's reflector is: each joint in turn, the last first; degrees, mm."""
    point = np.tile(tool, (len(angles), 1))
    for k, line in reversed(list(enumerate(ARM.split(", ")))):
        axis, *at = line.split()
        about = np.eye(3)["ABC".index(axis[0])]
        place = np.array(at, dtype=np.float64)
        turn = Rotation.from_rotvec(np.radians(angles[:, k])[:, None] * about)
        point = place + turn.apply(point - place)
    return point


def written(path: Path, names: str, *columns: F64) -> Path:
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(names.split())
        table.writerows(np.column_stack(columns).tolist())
    return path


def vectors(campaign: Campaign) -> F64:
    """The three components of each point, (n, 3), mm."""
    return np.stack([campaign.value[campaign.conditions.u[:, k] == 1.0] for k in range(3)], axis=1)


def test_errors_of_a_machine_are_left_but_for_where_the_tracker_stands(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    at = rng.uniform(-400.0, 400.0, (60, 3))
    error = 1e-4 * np.abs(at[:, [1, 2, 0]]) ** 1.5 * 1e-3
    path = written(tmp_path / "p.csv", "X Y Z x y z", at, STAND.apply(at + error) + SHIFT)
    found = vectors(import_points(path, machine("w b X Y Z t")))
    # apart: the same by SciPy, and what no rigid motion takes
    turn, _ = Rotation.align_vectors(
        STAND.apply(at + error) - STAND.apply(at + error).mean(axis=0), at - at.mean(axis=0)
    )
    back = turn.inv().apply(STAND.apply(at + error) - STAND.apply(at + error).mean(axis=0))
    np.testing.assert_allclose(found, back - (at - at.mean(axis=0)), atol=1e-9)
    assert np.std(found) > 1e-5


def test_where_an_arm_holds_its_reflector_is_found(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    angles = rng.uniform(-70.0, 70.0, (25, 5))
    seen = STAND.apply(reached(angles, TOOL)) + SHIFT
    arm = machine("w b C1 B2 B3 A4 B5 t", ARM)
    path = written(tmp_path / "p.csv", "C1 B2 B3 A4 B5 px py pz", angles, seen * 1e-3)
    campaign = import_points(path, arm, unit="m")
    assert np.abs(campaign.value).max() < 2e-3, "the offset is written in µm"
    assert campaign.conditions.tool[0] == pytest.approx(TOOL, abs=1e-3)
    assert campaign.setups["p"].free == ("frame",)
    write_campaign(campaign, tmp_path / "c.csv")
    again = read_campaign(tmp_path / "c.csv", arm)
    np.testing.assert_allclose(again.conditions.tool, campaign.conditions.tool)
    np.testing.assert_allclose(again.value, campaign.value, atol=1e-8)
    # an offset that is known is not looked for
    known = ForeignPlacing(tool=(310.0, -20.0, 45.0))
    stated = import_points(path, arm, known, unit="m", tool_known=True)
    assert np.abs(stated.value).max() < 1e-9


def test_a_reflector_far_from_the_origin_is_found_by_two_joints_alone(tmp_path: Path) -> None:
    """The other joints rest: from the origin the offset is looked for in vain."""
    arm = machine("w b C1 B2 B4 B6 t", "C1 0 0 0, B2 0 0 340, B4 0 0 740, B6 0 0 1140")
    tool = np.array([1.0, 1.0, 1331.0])
    c, b = np.repeat(np.linspace(-90.0, 150.0, 14), 14), np.tile(np.linspace(-85.0, 85.0, 14), 14)
    about = np.array([0.0, 0.0, 340.0])
    raised = Rotation.from_euler("y", b[:, None], degrees=True).apply(tool - about) + about
    seen = Rotation.from_euler("z", c[:, None], degrees=True).apply(raised)
    rest = np.zeros((len(c), 2))
    path = written(tmp_path / "p.csv", "C1 B2 B4 B6 x y z", c, b, rest, STAND.apply(seen) + SHIFT)
    campaign = import_points(path, arm)
    assert np.abs(campaign.value).max() < 2e-3
    assert campaign.conditions.tool[0] == pytest.approx(tool, abs=1e-3)


def test_one_point_of_another_pose_is_named_by_its_line(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    angles = rng.uniform(-70.0, 70.0, (25, 5))
    seen = STAND.apply(reached(angles, TOOL) + rng.normal(0.0, 0.1, (25, 3))) + SHIFT
    seen[17] += [1200.0, -900.0, 0.0]
    arm = machine("w b C1 B2 B3 A4 B5 t", ARM)
    path = written(tmp_path / "p.csv", "C1 B2 B3 A4 B5 x y z", angles, seen)
    with pytest.raises(InputError, match="a point does not belong") as refused:
        import_points(path, arm)
    assert refused.value.line == 19, "the heading is line 1"


def test_what_is_none_of_this_machine_is_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    angles = rng.uniform(-70.0, 70.0, (25, 5))
    seen = STAND.apply(reached(angles, TOOL)) + SHIFT
    arm = machine("w b C1 B2 B3 A4 B5 t", ARM)
    path = written(tmp_path / "p.csv", "C1 B2 B3 A4 B5 x y z", angles, seen)
    for wrong, unit in ((written(tmp_path / "q.csv", "B5 B2 B3 A4 C1 x y z", angles, seen), "mm"),
                        (path, "um")):  # fmt: skip
        with pytest.raises(InputError, match="none of this machine"):
            import_points(wrong, arm, unit=unit)
    with pytest.raises(InputError, match="no columns of the points"):
        import_points(path, arm, measured=["x", "y", "height"])
    with pytest.raises(InputError, match="where axis A4 stood is not stated"):
        import_points(written(tmp_path / "r.csv", "C1 B2 B3 x y z", angles[:, :3], seen), arm)
    still = written(tmp_path / "s.csv", "C1 B2 B3 A4 B5 x y z", angles, np.tile(SHIFT, (25, 1)))
    with pytest.raises(InputError, match="the points are all the same"):
        import_points(still, arm)
    table = machine("w X' b Y Z t")
    with pytest.raises(InputError, match="an axis that carries the workpiece moves"):
        import_points(written(tmp_path / "t.csv", "X Y Z x y z", seen, seen), table)
