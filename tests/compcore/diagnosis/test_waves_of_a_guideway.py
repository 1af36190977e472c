"""Waves of a rail's bolts are the carriage's straightness, no dent and no screw."""

from __future__ import annotations

import numpy as np

from abbe.compcore.diagnosis.verdict import diagnose
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from benchmarks.hidden.judging import trial

SLIDE = """format = "abbe-model/1"
[machine]
name = "slide on rails"
structure = "w b X Z t"
[machine.axes.X]
travel = [0.0, 960.0]
[machine.axes.Z]
travel = [-300.0, 0.0]
[[effects]]
kind = "straightness"
axis = "X"
direction = "Z"
shape = "spline:8"
"""


def test_waves_finer_than_twice_the_curve_are_still_the_carriage_s_own() -> None:
    """Bolts every 80 mm, pressed unequally, on nine lines: 8 or 16 coefficients show nothing."""
    rng = np.random.default_rng(11)
    pressed = rng.uniform(1.0, 5.0, 12)
    model = parse_model(TomlSource(SLIDE))
    head = '# format = "abbe-campaign/1"\n'
    for k in range(9):
        head += f'# [setups.l{k}]\n# free = ["zero", "slope"]\n'
    head += "time,setup,kind,X,Z,tool_z,ux,uy,uz,value,sd\n"
    rows, t = [], 0
    for k in range(9):
        for x in np.sort(rng.uniform(0.0, 960.0, 40)):
            bolt = pressed[int(x // 80.0) % 12]
            value = bolt * np.sin(np.pi * x / 80.0) ** 2 + rng.normal(0.0, 0.4)
            place = f"{x:.1f},{-30 * k},-100,0,0,1"
            rows.append(f"{t},l{k},displacement,{place},{value:.3f},0.4")
            t += 15
    found = diagnose(model, trial.as_campaign(head + "\n".join(rows) + "\n", model))
    assert {e.effect.kind for e in found.established} == {"straightness"}
