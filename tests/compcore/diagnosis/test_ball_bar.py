"""Circles by a ball bar in three planes: play, scales and squareness by their names."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from abbe.compcore.diagnosis import diagnose
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model

TRAVEL = {"X": (0.0, 600.0), "Y": (0.0, 500.0), "Z": (0.0, 400.0)}
AXES = {a: Axis(a, t) for a, t in TRAVEL.items()}
MACHINE = Machine("mill", Structure.parse("w X' Y' b Z t"), AXES, {})
RADIUS, CENTRE = 150.0, np.array([300.0, 250.0, 200.0])
PLAY, SCALE, XY, YZ = 4e-3, -25e-6, 30e-6, -12e-6
COLUMNS = "time,setup,kind,X,Y,Z,X_dir,Y_dir,Z_dir,ux,uy,uz,value"


def circles(path: Path) -> Path:
    """Two senses in each plane; bar's length and its centre unknown; 0.3 µm of noise."""
    rng = np.random.default_rng(5)
    head, rows, now = ['# format = "abbe-campaign/1"'], [], 0
    for plane, (a, b) in {"XY": (0, 1), "ZX": (2, 0), "YZ": (1, 2)}.items():
        for sense in (1, -1):
            name = f"{plane}{'+' if sense > 0 else '-'}"
            head += [f'# [setups."{name}"]', '# free = ["zero", "frame"]']
            centre, length = rng.normal(0.0, 0.004, 3), rng.normal(0.0, 0.01)
            for angle in sense * 2.0 * np.pi * np.arange(120) / 120 + 0.01:
                u, way = np.zeros(3), np.zeros(3)
                u[a], u[b] = np.cos(angle), np.sin(angle)
                way[a], way[b] = -sense * np.sin(angle), sense * np.cos(angle)
                at, way = CENTRE + RADIUS * u, np.sign(np.round(way, 9))
                off = np.array([PLAY / 2 * way[0], XY * at[0] + SCALE * at[1], YZ * at[1]])
                value = 1e3 * ((off - centre) @ u + length) + rng.normal(0.0, 0.3)
                numbers = [f"{v:.6f}" for v in (*at, *way, *u, value)]
                rows.append(f"{now},{name},displacement," + ",".join(numbers))
                now += 1
            now += 300
    path.write_text("\n".join([*head, COLUMNS, *rows]) + "\n")
    return path


def test_three_plain_causes_and_the_play_are_named_not_a_rare_one_and_a_shape(
    tmp_path: Path,
) -> None:
    """A cross error and an angular motion of eight coefficients imitate all but the play."""
    found = diagnose(Model(MACHINE, ()), read_campaign(circles(tmp_path / "c.csv"), MACHINE))
    estimates = {
        e.found.candidate.effect.spec: (p.value, p.sd)
        for e in found.established
        for p in e.estimates
    }
    # on the workpiece's side an angle between the axes is that of what the tool sees, reversed
    true = {
        "backlash axis=X": PLAY,
        "scale axis=Y": SCALE,
        "squareness axes=X,Y": -XY,
        "squareness axes=Y,Z": -YZ,
    }
    assert estimates.keys() == true.keys()
    for spec, (value, sd) in estimates.items():
        assert abs(value - true[spec]) < 3.5 * sd, spec
