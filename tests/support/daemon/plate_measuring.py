"""A ball plate on the table of the simulated I++ machine, and ``abbe measure`` that touches it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from abbe.compcore.artefacts.plate import rigid_placing
from abbe.compcore.files.model_file import load_model
from abbe.compcore.files.plan_file import read_plan
from abbe.compcore.files.plate_file import read_plate
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.daemon.commands.measurements.measure import run
from abbe.daemon.measure.events import MeasureEvent
from abbe.drivers.simulated.process import SimulatedProcess

HURRY = 4000.0
"""So many times faster than it is told the simulated machine moves."""
ASIDE = (2.0, -1.5, 1.0)
"""mm by which the plate lies off the plan."""
TURNED = (0.004, -0.003, 0.006)
"""rad, likewise."""

CONFIG = """format = "abbe-config/1"
model = "model.toml"
[cycle]
signals_every = 0.05
[guard]
max_correction = 0.1
max_rate = 0.5
stale_after = 5.0
signals_stale_after = 5.0
[axes.X]
source = "cmm.x"
[axes.Y]
source = "cmm.y"
[axes.Z]
source = "cmm.z"
[signals.T_x]
source = "cmm.T_x"
[signals.T_y]
source = "cmm.T_y"
[signals.T_z]
source = "cmm.T_z"
[signals.T_part]
source = "cmm.T_part"
[links.cmm]
driver = "ipp"
host = "127.0.0.1"
port = {port}
timeout = 10.0
reconnect_min = 0.05
[links.cmm.channels]
x = {{ axis = "X" }}
y = {{ axis = "Y" }}
z = {{ axis = "Z", offset = 150.0 }}
T_x = {{ scale_temperature = "X", every = 0.05 }}
T_y = {{ scale_temperature = "Y", every = 0.05 }}
T_z = {{ scale_temperature = "Z", every = 0.05 }}
T_part = {{ property = "Part.Temperature", unit = "degC", every = 0.05 }}
[measure]
signals_held = 0.1
[probing]
link = "cmm"
plate = "plate.csv"
tip = 4.0
points = 5
plate_temperature = "T_part"
{more}
"""

MODEL = """format = "abbe-model/1"
[machine]
name = "Bridge CMM"
structure = "w b Y X Z t"
reference_temperature = 20.0
[machine.axes]
X = {{ travel = [0.0, 700.0] }}
Y = {{ travel = [0.0, 900.0] }}
Z = {{ travel = [-360.0, 0.0] }}
[machine.signals]
T_x = {{ unit = "degC", role = "scale", axis = "X" }}
T_y = {{ unit = "degC", role = "scale", axis = "Y" }}
T_z = {{ unit = "degC", role = "scale", axis = "Z" }}
T_part = {{ unit = "degC", role = "workpiece" }}
{effects}"""


def write_files(
    folder: Path, port: int, side: int, pitch: float, effects: str = "", more: str = ""
) -> None:
    """Model, configuration, and the certificate of a plate of `side` × `side` balls."""
    along = np.arange(side) * pitch
    balls = np.array([[x, y, 0.0] for y in along for x in along])
    # no plate is made as it is meant: this is what its calibration found
    balls += np.random.default_rng(3).normal(0.0, 0.02, balls.shape)
    rows = "".join(
        f"{i},{x:.4f},{y:.4f},{z:.4f}\n" for i, (x, y, z) in enumerate(balls.tolist(), start=1)
    )
    head = "# diameter = 22\n# sd = 0.1\n# expansion = 11.5\nball,cx,cy,cz\n"
    (folder / "plate.csv").write_text(head + rows, encoding="utf-8")
    (folder / "model.toml").write_text(MODEL.format(effects=effects), encoding="utf-8")
    (folder / "config.toml").write_text(CONFIG.format(port=port, more=more), encoding="utf-8")


def plan_text(setups: Sequence[PlannedSetup]) -> str:
    """A plan of some placings, as a person may have written it."""
    text = 'format = "abbe-plan/1"\nmodel = "model.toml"\nstructure = "w b Y X Z t"\nwarm_up = 0\n'
    text += "beyond = 2\n[tools]\nP = [0.0, 0.0, -150.0]\n"
    for i, setup in enumerate(setups, start=1):
        rows = np.stack([setup.targets[a] for a in "XYZ"], axis=1).tolist()
        text += (
            f'\n[[setups]]\nname = "p{i}"\nwhat = "{setup.what}"\ninstrument = "ball-plate"\n'
            f'kind = "displacement"\nfree = ["frame"]\ntool = "P"\nboth_ways = false\n'
            f'axes = ["X", "Y", "Z"]\ntargets = {rows}\nread = [{setup.u[0].tolist()}]\n'
            "sd = [0.5]\n"
        )
    return text


def lay(process: SimulatedProcess, folder: Path, name: str, aside: Sequence[float] = ASIDE) -> None:
    """Lay the plate where a set-up of the plan has it, somewhat aside and turned."""
    plate = read_plate(folder / "plate.csv")
    machine = load_model(folder / "model.toml").machine
    setup = next(s for s in read_plan(folder / "plan.toml", machine).setups if s.name == name)
    turn, shift = rigid_placing(plate.calibrated, setup.path())
    angle = np.array(TURNED)
    skew = np.array([[0, -angle[2], angle[1]], [angle[2], 0, -angle[0]], [-angle[1], angle[0], 0]])
    left, _, right = np.linalg.svd((np.eye(3) + skew) @ turn)
    vector = _rotation_vector(left @ right)
    process.order(
        "plate", balls=plate.calibrated.tolist(), diameter=plate.diameter,
        turn=vector.tolist(), at=(shift + np.array(aside)).tolist(), expansion=plate.expansion,
    )  # fmt: skip


def _rotation_vector(turn: np.ndarray) -> np.ndarray:
    axial = 0.5 * np.array(
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    )
    sine = float(np.linalg.norm(axial))
    angle = np.arctan2(sine, 0.5 * (np.trace(turn) - 1.0))
    return axial if sine < 1e-12 else axial * (angle / sine)


def lift(process: SimulatedProcess) -> None:
    """Jog the tip up, when the server knows that nobody moves it any more."""
    _nobody_there(process)
    process.order("lift")


def put_back(process: SimulatedProcess, ball: int) -> None:
    """Put a ball back where it was, the tip jogged up before."""
    _nobody_there(process)
    process.order("gone", ball=ball, back=True)


def _nobody_there(process: SimulatedProcess) -> None:
    # a client whose end the server has not heard yet stops the machine when it does
    until = time.monotonic() + 30.0
    while process.order("report")["clients"]:
        assert time.monotonic() < until
        time.sleep(0.02)


class Listener:
    """Hears what a measurement tells, and does something when it hears of it.

    Parameters
    ----------
    what
        Words → what is done, once each, in this order.
    """

    def __init__(self, *what: tuple[str, Callable[[], object]]) -> None:
        self.events: list[MeasureEvent] = []
        self._waiting = list(what)

    def __call__(self, event: MeasureEvent) -> None:
        """Hear of something."""
        self.events.append(event)
        if self._waiting and self._waiting[0][0] in event.text:
            self._waiting.pop(0)[1]()

    @property
    def heard(self) -> bool:
        """Whether all was heard that was waited for."""
        return not self._waiting

    def rows(self) -> int:
        """Balls whose rows are on the disk."""
        return sum(e.kind == "row" for e in self.events)


def measured(folder: Path, *what: tuple[str, Callable[[], object]]) -> Listener:
    """``abbe measure plan.toml config.toml -o campaign.csv --yes`` to its end, in this process.

    Raises
    ------
    AbbeError
        As the command.
    """
    heard = Listener(*what)
    paths = (folder / name for name in ("plan.toml", "config.toml", "campaign.csv"))
    run(*paths, (), heard, yes=True, once=False)
    assert heard.heard, [e.text for e in heard.events[-4:]]
    return heard


def machine(*more: str) -> SimulatedProcess:
    """The simulated I++ machine, standing up high."""
    return SimulatedProcess(
        "ipp", "--hurry", str(HURRY), "--stand-at", "350,450,-20", "--seats", "1", *more
    )


def exact(process: SimulatedProcess, points: Any) -> Mapping[str, np.ndarray]:
    """The exact machine's errors at indicated positions and its temperatures, mm, °C."""
    found = process.order("truth", points=np.asarray(points).tolist(), tool=[0.0, 0.0, -150.0])
    return {k: np.array(found[k]) for k in ("errors", "temperatures")}
