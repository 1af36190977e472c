"""A worm's wave on a rotary axis, beside the wheel's run-out: named with its period in degrees."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.diagnosis import diagnose
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.units import read_in
from benchmarks.hidden.judging.trial import as_campaign

STEP, TEETH = 3.7, 36
"""Degrees between the angles of a polygon or autocollimator; teeth of the wheel."""


def test_a_worm_and_its_wheel():
    model = parse_model(
        TomlSource("""
format = "abbe-model/1"
[machine]
name = "table"
structure = "w C' b X Y Z t"
axes.X.travel = [-400.0, 400.0]
axes.Y.travel = [-400.0, 400.0]
axes.Z.travel = [-300.0, 300.0]
axes.C.travel = [0.0, 360.0]
""")
    )
    rng = np.random.default_rng(1)
    rows = ['# format = "abbe-campaign/1"', "time,setup,kind,X,Y,Z,C,C_dir,ux,uy,uz,value"]
    for way in (1, -1):
        for angle in np.arange(0.0, 360.0, STEP)[::way]:
            at = np.deg2rad(angle)
            error = 20.0 * np.sin(TEETH * at + 0.4) + 30.0 * np.cos(at + 1.0)
            time, value = 5 * len(rows), error + rng.normal(0.0, 1.5)
            rows.append(f"{time},p,rotation,0,0,0,{angle:.6f},{way},0,0,1,{value:.3f}")
    found = diagnose(model, as_campaign("\n".join(rows) + "\n", model))
    specs = [e.found.candidate.effect.spec for e in found.established]
    assert specs == ["rotary_positioning axis=C harmonics=1", "cyclic axis=C"]
    effect = found.established[1].found.candidate.effect
    (period,) = effect.nonlinear(model.machine)
    unit, factor = read_in(period)
    values = {e.name: e.value for e in found.established[1].estimates}
    assert unit == "°"
    assert values["period"] * factor == pytest.approx(10.0, abs=0.005)
    assert np.hypot(values["A1"], values["B1"]) == pytest.approx(20e-6, abs=1e-6)
