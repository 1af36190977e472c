"""Machines without one of X, Y, Z, or without linear axes: models and two days of measurements.

What is measured follows closed forms that stand here, not Abbe's kinematics.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

PLAY = 6.0
"""µm by which the lathe's X and the slit stand further towards minus when they come from above."""
ZERO = 8e-4
"""rad by which the second joint of arm and SCARA robot stands further than it shows."""
FIRST, SECOND = 325.0, 225.0
"""Lengths of the robots' links, mm."""

_MACHINE = 'format = "abbe-model/1"\n[machine]\nname = "{name}"\nserial = "{name}-7"\n'
_LINK = f"location = [{FIRST}, 0, 0]\n"
_MODELS = {
    "lathe": 'structure = "w (C\') b Z X t"\n[machine.axes.X]\ntravel = [0, 250]\n'
    "[machine.axes.Z]\ntravel = [0, 600]\n",
    "slit": 'structure = "w b X t"\n[machine.axes.X]\ntravel = [0, 200]\n',
    "SCARA": 'structure = "w b C C2 Z t"\n[machine.axes.C]\ntravel = [-120, 120]\n'
    f"[machine.axes.C2]\ntravel = [-140, 140]\n{_LINK}[machine.axes.Z]\ntravel = [-200, 0]\n",
    "arm": 'structure = "w b C C2 t"\n[machine.axes.C]\ntravel = [-120, 120]\n'
    f"[machine.axes.C2]\ntravel = [-140, 140]\n{_LINK}",
}

ARM_CONFIG = """format = "abbe-config/1"
model = "arm.toml"
[guard]
max_correction = 1.0
max_rate = 1.0
[axes.C]
source = "robot.c"
[axes.C2]
source = "robot.c2"
[links.robot]
driver = "serial"
port = "/dev/none"
[links.robot.messages.all]
query = "R"
pattern = '(?P<c>\\S+) (?P<c2>\\S+)'
[links.robot.channels]
c = { message = "all", unit = "deg" }
c2 = { message = "all", unit = "deg" }
"""
"""The arm's display on a serial line."""


def write_machine(name: str, folder: Path) -> tuple[Path, Path, Path]:
    """The model without effects and the campaigns of two days; `name` is one of `_MODELS`."""
    model = folder / f"{name}.toml"
    model.write_text(_MACHINE.format(name=name) + _MODELS[name], encoding="utf-8")
    rows: Callable[[np.random.Generator], Iterator[str]] = {
        "lathe": _lathe, "slit": _slit, "SCARA": lambda rng: _robot(rng, z=True),
        "arm": lambda rng: _robot(rng, z=False),
    }[name]  # fmt: skip
    days = []
    for day in (1, 2):
        path = folder / f"{name}-{day}.csv"
        lines = [
            '# format = "abbe-campaign/1"', f'# machine = "{name}"', f'# serial = "{name}-7"',
            f"# date = 2026-03-0{day}", '# operator = "R. Meier"', '# instrument = "laser"',
            '# environment = "hall 3"', *rows(np.random.default_rng(day)),
        ]  # fmt: skip
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        days.append(path)
    return model, days[0], days[1]


def _lathe(rng: np.random.Generator) -> Iterator[str]:
    yield "time,setup,kind,Z,X,Z_dir,X_dir,tool_z,ux,uy,uz,value,sd"
    t, away = 0, float(rng.uniform(0.0, 20.0))
    for k, z in enumerate((60.0 + away, 300.0 + away, 560.0 + away)):
        for sense in (1, -1, 1, -1):
            for x in np.linspace(10.0 + away / 2, 240.0, 9)[::sense]:
                t += 10
                value = -PLAY * (sense < 0) + rng.normal(0.0, 0.4)
                yield f"{t},X{k},displacement,{z:.3f},{x:.3f},0,{sense},80,1,0,0,{value:.2f},0.4"
    for k, x in enumerate((60.0 + away, 200.0 + away)):
        for sense in (1, -1):
            for z in np.linspace(10.0 + away, 590.0, 9)[::sense]:
                t += 10
                value = rng.normal(0.0, 0.4)
                yield f"{t},Z{k},displacement,{z:.3f},{x:.3f},{sense},0,80,0,0,1,{value:.2f},0.4"


def _slit(rng: np.random.Generator) -> Iterator[str]:
    yield "time,setup,kind,X,X_dir,ux,uy,uz,value,sd"
    t, away = 0, float(rng.uniform(0.0, 4.0))
    for k in range(3):
        for sense in (1, -1, 1, -1):
            for x in np.linspace(2.0 + away, 196.0, 41)[::sense]:
                t += 10
                # and the pitch of a screw
                wave = 3.0 * math.sin(2.0 * math.pi * x / 30.0)
                value = wave - PLAY * (sense < 0) + rng.normal(0.0, 0.2)
                yield f"{t},x{k},displacement,{x:.3f},{sense},1,0,0,{value:.2f},0.2"


def _robot(rng: np.random.Generator, *, z: bool) -> Iterator[str]:
    yield '# [setups.poses]\n# free = ["frame"]'
    yield f"time,setup,kind,C,C2,{'Z,' * z}tool_x,tool_z,ux,uy,uz,value,sd"
    for k in range(50):
        c, c2 = rng.uniform(-120.0, 120.0), rng.uniform(-140.0, 140.0)
        there = f"{rng.uniform(-200.0, 0.0):.3f}," if z else ""
        at = math.radians(c + c2)
        error = [
            1e3 * SECOND * (math.cos(at + ZERO) - math.cos(at)),
            1e3 * SECOND * (math.sin(at + ZERO) - math.sin(at)),
            0.0,
        ]
        for axis, u in enumerate(("1,0,0", "0,1,0", "0,0,1")):
            value = error[axis] + rng.normal(0.0, 10.0)
            yield (f"{20 * k},poses,displacement,{c:.4f},{c2:.4f},{there}{FIRST + SECOND},-50,"
                   f"{u},{value:.2f},10")  # fmt: skip
