"""A small machine and campaigns of it with closed answers: a scale that grows with its warmth."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

MODEL = """format = "abbe-model/1"
[machine]
name = "Small"
serial = "4711"
structure = "w b Y X Z t"
[machine.axes.X]
travel = [0.0, 500.0]
[machine.axes.Y]
travel = [0.0, 400.0]
[machine.axes.Z]
travel = [-300.0, 0.0]
[machine.signals.T_x]
unit = "degC"
role = "scale"
axis = "X"
[machine.signals.T_hall]
unit = "degC"
role = "ambient"
[[effects]]
kind = "scale_expansion"
axis = "X"
signals = ["T_x"]
"""
ALPHA = 1.1e-5
"""1/K"""
SD = 0.4
"""Standard uncertainty of a reading, µm."""
SAID = {
    "machine": "Small",
    "serial": "4711",
    "date": "2026-03-02",
    "operator": "R. Meier <r@m>",
    "instrument": "XL-80, 12A345",
    "environment": "hall 3, doors shut",
    "warm_up": "2 h at 3000 rpm",
    "load": "none",
    "feed": "1500 mm/min",
    "notes": "after levelling",
}
"""What stands at the top of `campaign`, key → text; the date as TOML's own."""


def write_model(folder: Path) -> Path:
    """The model, not yet fitted."""
    path = folder / "small.toml"
    path.write_text(MODEL, encoding="utf-8")
    return path


def write_campaign(
    path: Path, *, seed: int, alpha: float = ALPHA, hall: float = 20.5, **said: str
) -> Path:
    """A line along X at five temperatures, two hours apart, each reading three times.

    `said` replaces or adds to what stands at its top; an empty text leaves a key out.
    """
    head_lines = {k: v for k, v in {**SAID, **said}.items() if v}
    head = ['# format = "abbe-campaign/1"']
    head += [f"# {k} = {v}" if k == "date" else f'# {k} = "{v}"' for k, v in head_lines.items()]
    head += ["# [setups.a]", "# free = []", "time,setup,kind,X,Y,Z,ux,uy,uz,value,sd,T_x,T_hall"]
    positions = np.tile(np.linspace(50.0, 450.0, 17), 5)
    warm = np.repeat(np.linspace(20.0, 27.0, 5), 17)
    noise = np.random.default_rng(seed).normal(size=(3, len(warm)))
    noise *= 0.99 / math.sqrt(float(np.mean(noise**2)))
    rows = [
        f"{60 * i + 7200 * (i // 17) + 10 * k},a,displacement,{x!r},120,-80,1,0,0,"
        f"{1e3 * alpha * x * (t - 20.0) + SD * e!r},{SD},{t!r},{hall + 0.01 * (i % 7)!r}"
        for i, (x, t) in enumerate(zip(positions.tolist(), warm.tolist(), strict=True))
        for k, e in enumerate(noise[:, i].tolist())
    ]
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    return path
