"""Two tapes of a scale: their joint is a step, no dent and no screw's wave; a curve is no joint."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from abbe.compcore.diagnosis.verdict import Diagnosis, diagnose
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from benchmarks.hidden.judging import trial

SLIDE = """format = "abbe-model/1"
[machine]
name = "slide of 3 m"
structure = "w b X Z t"
[machine.axes.X]
travel = [0.0, 3000.0]
[machine.axes.Z]
travel = [-300.0, 0.0]
[[effects]]
kind = "positioning"
axis = "X"
shape = "spline:8"
"""


def diagnosed(beside: Callable[[np.ndarray], np.ndarray], seed: int) -> Diagnosis:
    """Three lines along X, 41 uneven targets each, of a slide with a smooth curve and more, µm."""
    rng = np.random.default_rng(seed)
    head = '# format = "abbe-campaign/1"\n'
    head += "".join(f'# [setups.l{k}]\n# free = ["zero"]\n' for k in range(3))
    head += "time,setup,kind,X,Z,tool_z,ux,uy,uz,value,sd\n"
    rows, t = [], 0
    for k in range(3):
        x = np.sort(rng.uniform(0.0, 3000.0, 41))
        error = 6e-6 * (x - 1000.0) ** 2 + beside(x) + rng.normal(0.0, 0.5, 41)
        for at, value in zip(x, error, strict=True):
            rows.append(f"{t},l{k},displacement,{at:.1f},{-100 * k},-100,1,0,0,{value:.3f},0.5")
            t += 15
    model = parse_model(TomlSource(SLIDE))
    return diagnose(model, trial.as_campaign(head + "\n".join(rows) + "\n", model))


def test_a_joint_of_a_scale_is_named_where_it_lies() -> None:
    found = diagnosed(lambda x: -4.0 * (x > 1490.0), 5)
    (cause,) = found.established
    assert cause.effect.kind == "joint"
    values = {e.name: e.value for e in cause.estimates}
    assert values["step"] == pytest.approx(-4e-3, abs=1e-3)
    assert values["centre"] == pytest.approx(1490.0, abs=40.0)


def test_what_bends_over_half_a_metre_is_no_joint() -> None:
    found = diagnosed(lambda x: 5.0 * np.tanh((x - 1490.0) / 250.0), 5)
    assert all(cause.effect.kind != "joint" for cause in found.established)
