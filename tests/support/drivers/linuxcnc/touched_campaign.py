"""``abbe measure`` on the LinuxCNC that touches: its files, and what its rows have to show."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tests.support.drivers.linuxcnc import artefact
from tests.support.drivers.linuxcnc.touching_mill import TIP, TOOL, says

CONFIG = """format = "abbe-config/1"
model = "model.toml"
[cycle]
signals_every = 0.05
[guard]
max_correction = 0.1
max_rate = 0.5
stale_after = 10.0
[controller]
status = "mill.state"
require = 3
[axes.X]
source = "mill.x"
[axes.Y]
source = "mill.y"
[axes.Z]
source = "mill.z"
{more}
[links.mill]
driver = "linuxcnc"
timeout = 10.0
servo_silence = 10.0
[links.mill.channels]
x = {{ pin = "joint.0.pos-cmd", unit = "mm" }}
y = {{ pin = "joint.1.pos-cmd", unit = "mm" }}
z = {{ pin = "joint.2.pos-cmd", unit = "mm" }}
state = {{ word = "state" }}
{channels}
[probing]
link = "mill"
tip = {tip}
points = 5
approach = 1.0
search = 1.0
placing = 2.0
speed = 150.0
touch_speed = 1.5
{probing}
"""
LATE_UM = 1.5
"""µm that it goes on between two looks at the probe."""
MODEL = """format = "abbe-model/1"
[machine]
name = "Mill"
structure = "{structure}"
reference_temperature = 20.0
[machine.axes]
X = {{ travel = [-280.0, 280.0] }}
Y = {{ travel = [-280.0, 280.0] }}
Z = {{ travel = [-280.0, 0.0] }}
{axes}
"""
PLAN = """format = "abbe-plan/1"
model = "model.toml"
structure = "{structure}"
warm_up = 0
beyond = 2
[tools]
P = [0.0, 0.0, -100.0]
[[setups]]
name = "s1"
what = "by hand"
instrument = "{instrument}"
kind = "displacement"
free = ["{free}"]
tool = "P"
{setup}
"""
ASIDE = (0.6, -0.9, 0.7)
"""mm by which the sphere stands off the plan."""


def write_sphere(folder: Path, angles: Sequence[float], diameter: float) -> None:
    """Model, configuration, plan of a sphere at some angles (degrees), there and back."""
    structure = "w C' b X Y Z t"
    x, y, _ = artefact.LINE
    location = f"C = {{ travel = [-200.0, 200.0], location = [{x}, {y}, -250.0] }}"
    effect = '\n[[effects]]\nkind = "rotary_location"\naxis = "C"'
    model = MODEL.format(structure=structure, axes=location + effect)
    (folder / "model.toml").write_text(model, encoding="utf-8")
    turning = 'c = { pin = "axis.c.pos-cmd", scale = 0.017453292519943295, unit = "rad" }'
    config = CONFIG.format(
        tip=TIP, more='[axes.C]\nsource = "mill.c"', channels=turning,
        probing=f"sphere = {diameter}",
    )  # fmt: skip
    (folder / "config.toml").write_text(config, encoding="utf-8")
    stands = np.array(artefact.START) - ASIDE
    rows = []
    for angle in angles:
        at = _believed(angle, stands) - TOOL
        rows.append([float(angle), *(round(float(v), 4) for v in at)])
    setup = (
        'axis = "C"\nboth_ways = true\naxes = ["C", "X", "Y", "Z"]\n'
        f"targets = {rows}\nsd = [0.5]\n"
        "read = [[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]]\n"
    )
    plan = PLAN.format(structure=structure, instrument="sphere", free="frame", setup=setup)
    (folder / "plan.toml").write_text(plan, encoding="utf-8")


def _believed(angle: float, start: np.ndarray) -> np.ndarray:
    """Where the table as everybody believes it to be takes a place, mm."""
    s, c = np.sin(np.radians(angle)), np.cos(np.radians(angle))
    x, y, z = start - np.array(artefact.LINE)
    return np.add(artefact.LINE, (c * x + s * y, -s * x + c * y, z))


def sphere_errors(angles: np.ndarray) -> np.ndarray:
    """Actual − indicated of the sphere at angles of C (degrees), mm, (n, 3)."""
    start = np.array(artefact.START)
    really = np.array([artefact.centre(float(a)) for a in angles])
    believed = np.array([_believed(float(a), start) for a in angles])
    return np.asarray(believed - says(really))


def write_block(folder: Path, faces: Sequence[float], size: Sequence[float]) -> None:
    """Model, configuration, certificate of a gauge; the plan is for `abbe plan` to make."""
    structure = "w b X Y Z t"
    model = MODEL.format(structure=structure, axes="")
    (folder / "model.toml").write_text(model, encoding="utf-8")
    config = CONFIG.format(tip=TIP, more="", channels="", probing='gauge = "gauge.csv"')
    (folder / "config.toml").write_text(config, encoding="utf-8")
    rows = "".join(f"{i},{at}\n" for i, at in enumerate(faces, start=1))
    head = f"# width = {size[0]}\n# height = {size[1]}\n# sd = 0.1\n# expansion = 11.5\nface,at\n"
    (folder / "gauge.csv").write_text(head + rows, encoding="utf-8")
