"""A sphere on the simulated I++ machine's rotary table, and what its touches have to show."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from abbe.compcore.files.model_file import load_model
from abbe.compcore.planning.instruments import INSTRUMENTS
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups.rotations import spheres
from abbe.compcore.planning.targets import SurveyTask
from abbe.drivers.simulated.process import SimulatedProcess
from tests.support.daemon.plate_measuring import CONFIG, exact

TOOL = (0.0, 0.0, -150.0)
DIAMETER = 25.0
LINE = (350.0, 450.0)
"""Where the model has the table's line, X and Y, mm."""
BESIDE = (0.043, -0.027)
"""By how much it really lies beside that, X and Y, mm."""
LEAN = (60e-6, -45e-6)
"""By how much it leans about X and Y, rad."""
WRONG = 40e-6
"""Amplitude of the table's error of angle, rad."""
ASIDE = (1.5, -2.0, 1.0)
"""mm by which the sphere stands off the plan."""

MODEL = """format = "abbe-model/1"
[machine]
name = "Bridge CMM with a table"
structure = "w C' b Y X Z t"
reference_temperature = 20.0
[machine.axes]
X = {{ travel = [0.0, 700.0] }}
Y = {{ travel = [0.0, 900.0] }}
Z = {{ travel = [-360.0, 0.0] }}
C = {{ travel = [-200.0, 200.0], location = [350.0, 450.0, -480.0] }}
[machine.signals]
T_x = {{ unit = "degC", role = "scale", axis = "X" }}
T_y = {{ unit = "degC", role = "scale", axis = "Y" }}
T_z = {{ unit = "degC", role = "scale", axis = "Z" }}
T_part = {{ unit = "degC", role = "workpiece" }}
{effects}"""


def write_files(folder: Path, port: int, angles: Sequence[float], effects: str = "") -> None:
    """Model, configuration, and a plan of one sphere at some angles (degrees), there and back."""
    (folder / "model.toml").write_text(MODEL.format(effects=effects), encoding="utf-8")
    config = CONFIG.format(port=port, more="").replace(
        'plate = "plate.csv"', f"sphere = {DIAMETER}"
    )
    # the server counts the table as it turns; C' grows the other way
    config = config.replace(
        "T_x = { scale",
        'c = { axis = "R", scale = -0.017453292519943295, unit = "rad" }\nT_x = { scale',
    ).replace("[signals.T_x]", '[axes.C]\nsource = "cmm.c"\n[signals.T_x]')
    (folder / "config.toml").write_text(config, encoding="utf-8")
    setup = planned(folder)
    rows = "".join(f"  {row},\n" for row in _targets(setup, angles))
    (folder / "plan.toml").write_text(
        'format = "abbe-plan/1"\nmodel = "model.toml"\nstructure = "w C\' b Y X Z t"\nwarm_up = 0\n'
        "beyond = 2\n[tools]\nP = [0.0, 0.0, -150.0]\n"
        f'\n[[setups]]\nname = "s1"\nwhat = "{setup.what}"\ninstrument = "sphere"\n'
        'kind = "displacement"\nfree = ["frame"]\naxis = "C"\ntool = "P"\nboth_ways = true\n'
        f'axes = ["C", "X", "Y", "Z"]\ntargets = [\n{rows}]\n'
        "read = [[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]]\nsd = [0.5]\n",
        encoding="utf-8",
    )


def planned(folder: Path) -> PlannedSetup:
    """The first place that `abbe plan` has for a sphere."""
    task = SurveyTask(load_model(folder / "model.toml"), tools={"P": TOOL})
    return next(iter(spheres(task, INSTRUMENTS["sphere"])))


def _targets(setup: PlannedSetup, angles: Sequence[float]) -> list[list[float]]:
    """Targets worked out by hand: C' positive turns the table, and the sphere, clockwise."""
    start = np.array(setup.optics["the sphere stands"]) - np.array([*LINE, 0.0])
    found = []
    for angle in angles:
        s, c = np.sin(np.radians(angle)), np.cos(np.radians(angle))
        x, y = c * start[0] + s * start[1], -s * start[0] + c * start[1]
        found.append([float(v) for v in (angle, LINE[0] + x, LINE[1] + y, start[2] + 150.0)])
    return found


def stand(process: SimulatedProcess, folder: Path, aside: Sequence[float] = ASIDE) -> None:
    """Put the sphere where the plan has it, somewhat aside; the table lies beside its line."""
    process.order(
        "table", at=[LINE[0] + BESIDE[0], LINE[1] + BESIDE[1], -480.0], lean=LEAN, wrong=WRONG
    )
    push(process, folder, aside)


def push(process: SimulatedProcess, folder: Path, aside: Sequence[float]) -> None:
    """Put the sphere so far (mm) aside of where the plan has it; the table stays as it is."""
    place = np.array(planned(folder).optics["the sphere stands"]) + np.array(aside)
    process.order(
        "plate", balls=[[0.0, 0.0, 0.0]], diameter=DIAMETER, at=place.tolist(), thickness=2.0,
        expansion=0.0,
    )  # fmt: skip


def true_errors(process: SimulatedProcess, folder: Path, angles: np.ndarray) -> np.ndarray:
    """Actual − indicated of the sphere at angles of C (degrees) in machine axes, mm, (n, 3).

    The sphere turns about the line that there is; the machine comes to it with its own errors and
    says where it is; the controller turns that back about the line that it believes in.
    """
    start = np.array(planned(folder).optics["the sphere stands"]) + np.array(ASIDE)
    middle = np.array([LINE[0] + BESIDE[0], LINE[1] + BESIDE[1], -480.0])
    along = _turn(np.array([LEAN[0], LEAN[1], 0.0])) @ np.array([0.0, 0.0, 1.0])
    found = []
    for angle in angles:
        shown = -np.radians(angle)
        table = _turn((shown + WRONG * np.sin(shown)) * along)
        actual = middle + table @ (start - middle)
        says = actual.copy()
        for _ in range(3):
            errors = exact(process, [says - np.array(TOOL)])["errors"][0]
            says = actual - errors
        believed = _turn(np.array([0.0, 0.0, shown]))
        line = np.array([*LINE, 0.0])
        found.append(line + believed @ (start - line) - says)
    return np.array(found)


def _turn(vector: np.ndarray) -> np.ndarray:
    """Rotation by a vector (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)
