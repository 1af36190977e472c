"""Poses of a robot are drawn where its joints take the tool; a long flat volume is drawn whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.comparison.compare import Comparison, compare
from abbe.compcore.figures.figure import space
from abbe.compcore.figures.places import places
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.daemon.workbench.residuals.rows import rows_json

ARM = 300.0  # mm from the first joint to the second, and the tool's reach beyond it
REACH = 250.0
TOOL = ARM + REACH

MODEL = """format = "abbe-model/1"
[machine]
name = "SCARA"
structure = "w b C C2 Z t"
[machine.axes.C]
travel = [-120, 120]
[machine.axes.C2]
travel = [-140, 140]
location = [300, 0, 0]
[machine.axes.Z]
travel = [-200, 0]
"""


def measured(folder: Path, poses: np.ndarray) -> Campaign:
    """A SCARA robot's poses, C, C2 (degrees), Z (mm), each measured in X, Y and Z."""
    (folder / "scara.toml").write_text(MODEL)
    noise = np.random.default_rng(4)
    rows = [
        f"{20 * i},poses,displacement,{c},{c2},{z},{TOOL},0,-50,{u},{noise.normal(0, 10):.2f},10"
        for i, (c, c2, z) in enumerate(poses)
        for u in ("1,0,0", "0,1,0", "0,0,1")
    ]
    head = "time,setup,kind,C,C2,Z,tool_x,tool_y,tool_z,ux,uy,uz,value,sd"
    free = '# format = "abbe-campaign/1"\n# [setups.poses]\n# free = ["frame"]\n'
    path = folder / "poses.csv"
    path.write_text(free + "\n".join([head, *rows]) + "\n")
    return read_campaign(path, load_model(folder / "scara.toml").machine)


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    """Eighty of them, anywhere."""
    return np.random.default_rng(1).uniform((-120, -140, -200), (120, 140, 0), (80, 3)).round(4)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory, poses: np.ndarray) -> Comparison:
    """The robot without effects beside its poses."""
    folder = tmp_path_factory.mktemp("scara")
    campaign = measured(folder, poses)
    return compare(load_model(folder / "scara.toml"), campaign)


def test_poses_stand_where_the_joints_take_the_tool(robot: Comparison, poses: np.ndarray) -> None:
    campaign, machine = robot.problem.campaign, robot.problem.model.machine
    first, second = np.radians(poses[:, 0]), np.radians(poses[:, :2].sum(axis=1))
    there = np.stack(
        [
            ARM * np.cos(first) + REACH * np.cos(second),
            ARM * np.sin(first) + REACH * np.sin(second),
            poses[:, 2] - 50.0,
        ],
        axis=1,
    )
    np.testing.assert_allclose(places(campaign, machine)[::3], there, atol=1e-9)
    # the workbench draws them there as well, and the page has a picture of the volume
    shown = rows_json(campaign, machine, np.arange(0, campaign.n, 3))["place"]
    np.testing.assert_allclose(np.reshape(shown, (-1, 3)), there, atol=1e-4)
    assert "residuals in the volume" in robot.figures()


def test_a_long_flat_volume_is_drawn_whole_and_true() -> None:
    """A lathe's: 500 mm along Z, 200 along X, nothing along Y."""
    at = np.array([[0.0, 0.0, -500.0], [-200.0, 0.0, 0.0], [np.nan] * 3])
    scene = space(at, ["X (mm)", "Y (mm)", "Z (mm)"])
    long = {k: np.ptp(scene[f"{k}axis"]["range"]) for k in "xyz"}
    ratio = scene["aspectratio"]
    assert max(ratio.values()) == 1.0
    assert ratio["y"] >= 0.25
    # a mm is as long along each axis, and all points are inside
    np.testing.assert_allclose([ratio[k] * long["z"] for k in "xyz"], [long[k] for k in "xyz"])
    for k, (low, high) in zip("xyz", ((-200, 0), (0, 0), (-500, 0)), strict=True):
        first, last = scene[f"{k}axis"]["range"]
        assert first < low
        assert high < last
