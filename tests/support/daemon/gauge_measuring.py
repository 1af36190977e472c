"""A step gauge on the simulated I++ machine's table, and what its touches have to show."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from abbe.compcore.files.gauge_file import read_gauge
from abbe.compcore.files.model_file import load_model
from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups.gauges import probed_gauges
from abbe.compcore.planning.targets import SurveyTask
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.plate_measuring import CONFIG, MODEL, exact

TOOL = (0.0, 0.0, -150.0)
WIDTH, HEIGHT = 16.0, 20.0
BLOCK = (0.0, 300.0007)
STEPS = (0.0, 20.0003, 60.0011, 79.9989, 160.0021, 180.0004, 279.9975, 300.0007)
"""Faces, mm: a gauge block's, and a step gauge's."""
ASIDE = (1.2, -0.8, 0.9)
"""mm by which the gauge lies off the plan."""
TURNED = (0.0004, -0.003, 0.004)
"""rad, likewise."""


def write_files(folder: Path, port: int, faces: Sequence[float], more: str = "") -> None:
    """Model, configuration, the gauge's certificate."""
    rows = "".join(f"{i},{at}\n" for i, at in enumerate(faces, start=1))
    head = f"# width = {WIDTH}\n# height = {HEIGHT}\n# sd = 0.1\n# expansion = 11.5\nface,at\n"
    (folder / "gauge.csv").write_text(head + rows, encoding="utf-8")
    (folder / "model.toml").write_text(MODEL.format(effects=""), encoding="utf-8")
    config = CONFIG.format(port=port, more=f"placing = 2.0\n{more}")
    config = config.replace('plate = "plate.csv"', 'gauge = "gauge.csv"')
    (folder / "config.toml").write_text(config, encoding="utf-8")


def places(folder: Path) -> list[PlannedSetup]:
    """All places where the gauge can lie."""
    task = SurveyTask(load_model(folder / "model.toml"), tools={"P": TOOL})
    return list(probed_gauges(task, INSTRUMENTS["step-gauge"], read_gauge(folder / "gauge.csv")))


def plan(folder: Path, *numbers: int) -> list[PlannedSetup]:
    """A plan of some of them."""
    found = [places(folder)[i] for i in numbers]
    text = 'format = "abbe-plan/1"\nmodel = "model.toml"\nstructure = "w b Y X Z t"\nwarm_up = 0\n'
    text += "beyond = 2\n[tools]\nP = [0.0, 0.0, -150.0]\n"
    for i, setup in enumerate(found, start=1):
        rows = np.stack([setup.targets[a] for a in "XYZ"], axis=1).tolist()
        text += (
            f'\n[[setups]]\nname = "g{i}"\nwhat = "{setup.what}"\ninstrument = "step-gauge"\n'
            f'kind = "displacement"\nfree = ["zero"]\ntool = "P"\nboth_ways = false\n'
            f'axes = ["X", "Y", "Z"]\ntargets = {rows}\nread = [{setup.u[0].tolist()}]\n'
            "sd = [0.5]\n"
        )
    (folder / "plan.toml").write_text(text, encoding="utf-8")
    return found


def lay(
    process: SimulatedProcess, setup: PlannedSetup, faces: Sequence[float],
    aside: Sequence[float] = ASIDE,
) -> None:  # fmt: skip
    """Lay the gauge where a set-up of the plan has it, somewhat aside and turned."""
    along = setup.u[0, 0]
    angle = float(np.arctan2(along[1], along[0]))
    process.order(
        "gauge", steps=np.array(faces).reshape(-1, 2).tolist(), width=WIDTH, height=HEIGHT,
        turn=[TURNED[0], TURNED[1], TURNED[2] + angle],
        at=(setup.path()[0] + np.array(aside)).tolist(),
    )  # fmt: skip


def true_errors(process: SimulatedProcess, positions: np.ndarray, along: np.ndarray) -> np.ndarray:
    """The exact machine's errors along a direction at indicated positions (n, 3), µm."""
    return np.asarray(1e3 * exact(process, positions)["errors"] @ along)
