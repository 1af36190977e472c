"""Three lines and four body diagonals by laser: scales and squareness though an axis bows."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from abbe.compcore.diagnosis import diagnose
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model

ENDS = {"X": 800.0, "Y": 600.0, "Z": 500.0}
AXES = {a: Axis(a, (0.0, end)) for a, end in ENDS.items()}
MACHINE = Machine("mill", Structure.parse("w X' Y' b Z t"), AXES, {})
SCALES = {"scale axis=X": 8e-6, "scale axis=Y": -5e-6, "scale axis=Z": 12e-6}
XY, XZ, COSINE = 20e-6, -15e-6, 3e-6
LINES = {
    "X": ((0, 300, 250), (800, 300, 250)),
    "Y": ((400, 0, 250), (400, 600, 250)),
    "Z": ((400, 300, 0), (400, 300, 500)),
    "ppp": ((0, 0, 0), (800, 600, 500)),
    "ppn": ((0, 0, 500), (800, 600, 0)),
    "pnp": ((0, 600, 0), (800, 0, 500)),
    "npp": ((800, 0, 0), (0, 600, 500)),
}
COLUMNS = "time,setup,kind,X,Y,Z,ux,uy,uz,value"


def off(at: np.ndarray) -> np.ndarray:
    """The tool relative to the workpiece, mm; X bows by 6 µm in Z, which only diagonals show."""
    x, y, z = at
    kx, ky, kz = SCALES.values()
    bow = 6e-3 * np.sin(np.pi * x / ENDS["X"])
    return np.array([kx * x + XZ * z, ky * y + XY * x, kz * z + bow])


def measured(path: Path) -> Path:
    """Each line three times there and back; on one diagonal the beam lies 2.4 mrad beside it."""
    rng = np.random.default_rng(21)
    head = ['# format = "abbe-campaign/1"', '# instrument = "laser interferometer"']
    rows, now = [], 0
    for name, ends in LINES.items():
        head += [f"# [setups.{name}]", '# free = ["zero"]']
        first, last = (np.array(end, dtype=float) for end in ends)
        length = float(np.linalg.norm(last - first))
        u = (last - first) / length
        for k in [*range(21), *range(20, -1, -1)] * 3:
            at = first + (last - first) * k / 20
            value = float(off(at) @ u) - (COSINE * length * k / 20 if name == "npp" else 0.0)
            numbers = ",".join(f"{v:.6f}" for v in (*at, *u, 1e3 * value + rng.normal(0.0, 0.4)))
            rows.append(f"{now},{name},displacement,{numbers}")
            now += 5
        now += 1200
    path.write_text("\n".join([*head, COLUMNS, *rows]) + "\n")
    return path


def test_what_only_diagonals_show_is_an_axis_error_motion_not_a_rarer_cause(
    tmp_path: Path,
) -> None:
    """Which axis bows they do not tell; that one turns by where another stands is rarer."""
    found = diagnose(Model(MACHINE, ()), read_campaign(measured(tmp_path / "c.csv"), MACHINE))
    named = {e.effect.spec: e.estimates for e in found.established}
    assert not [spec for spec in named if spec.startswith("cross_angular")]
    assert [spec for spec in named if spec.startswith("straightness")]
    assert {"squareness axes=X,Y", "squareness axes=X,Z", "cosine setup=npp"} <= named.keys()
    for spec, true in SCALES.items():
        (k,) = named[spec]
        assert abs(k.value - true) < 3.5 * k.sd, spec


def test_a_roll_that_grows_with_its_own_axis_is_its_angular_motion(tmp_path: Path) -> None:
    """Levels on X and on Y: a roll of Y of 30 µrad is no turn of X by where Y stands."""
    rng = np.random.default_rng(71)
    head, rows = ['# format = "abbe-campaign/1"'], []
    for axis, other, u in (("X", "Y", "1,0,0"), ("Y", "X", "0,1,0")):
        head += [f"# [setups.roll{axis}]", '# free = ["zero"]']
        for k in [*range(13)] * 3:
            at = {other: 0.5 * ENDS[other], "Z": 200.0, axis: ENDS[axis] * k / 12}
            value = (30.0 * k / 12 if axis == "Y" else 0.0) + rng.normal(0.0, 1.0)
            place = ",".join(f"{at[a]:g}" for a in "XYZ")
            rows.append(f"roll{axis},rotation,{place},{u},{value:.3f}")
    path = tmp_path / "levels.csv"
    path.write_text("\n".join([*head, "setup,kind,X,Y,Z,ux,uy,uz,value", *rows]) + "\n")
    found = diagnose(Model(MACHINE, ()), read_campaign(path, MACHINE))
    assert [e.effect.spec for e in found.established] == ["angular axis=Y about=Y"]
