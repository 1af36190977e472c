"""A lag far longer than a signal's cycle shifts its phase, and says what nobody has seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.diagnosis.judging.at_rest import beyond_what_was_seen
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit

MODEL = """format = "abbe-model/1"
[machine]
name = "mill"
structure = "w b X Y Z t"
[machine.axes.X]
travel = [0.0, 500.0]
[machine.axes.Y]
travel = [0.0, 500.0]
[machine.axes.Z]
travel = [-300.0, 0.0]
[machine.signals.oil]
unit = "degC"
role = "structure"
[[effects]]
kind = "thermal_offset"
direction = "Z"
signal = "oil"
tau = "fit"
"""
CYCLE, AMPLITUDE = 1260.0, 0.8
"""s, and K to both sides, of an oil cooler."""


@pytest.mark.parametrize(("k", "tau", "beyond"), [(4.0, 300.0, False), (300.0, 9000.0, True)])
def test_a_body_that_hardly_follows_is_as_large_as_nobody_saw(
    tmp_path: Path, k: float, tau: float, beyond: bool
) -> None:
    """Z in one place for five hours, µm; the response of a first order lag to a sine, by hand."""
    time = np.arange(0.0, 18000.0, 45.0)
    w = 2.0 * np.pi / CYCLE
    oil = 24.0 + AMPLITUDE * np.sin(w * time)
    start = w * tau / (1.0 + (w * tau) ** 2) * np.exp(-time / tau)
    lagged = np.sin(w * time - np.arctan(w * tau)) / np.hypot(1.0, w * tau) + start
    value = k * AMPLITUDE * lagged + 0.02 * np.random.default_rng(3).normal(size=len(time))
    rows = [
        f"{t:.1f},dZ,displacement,250,250,-150,0,0,1,{v:.5f},0.02,{o:.5f}"
        for t, v, o in zip(time, value, oil, strict=True)
    ]
    path = tmp_path / "cooler.csv"
    head = ['# format = "abbe-campaign/1"', "# [setups.dZ]", '# free = ["zero"]']
    head += ["time,setup,kind,X,Y,Z,ux,uy,uz,value,sd,oil"]
    path.write_text("\n".join([*head, *rows]) + "\n")
    model = parse_model(TomlSource(MODEL))
    result = fit(model, read_campaign(path, model.machine))
    (term,) = result.model.terms
    assert term.values["tau"].value == pytest.approx(tau, rel=0.2)
    assert beyond_what_was_seen(result, term.effect) is beyond
