"""What a fitted model knows decides between causes that a campaign cannot tell apart."""

from __future__ import annotations

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging.trial import as_campaign

MODEL = """
format = "abbe-model/1"
[machine]
name = "mill"
structure = "w b X Y Z t"
[machine.axes.X]
travel = [0.0, 400.0]
[machine.axes.Y]
travel = [0.0, 400.0]
[machine.axes.Z]
travel = [0.0, 400.0]
[machine.signals.T_front]
unit = "degC"
role = "structure"
[machine.signals.T_rear]
unit = "degC"
role = "structure"
[[effects]]
kind = "thermal_tilt"
axis = "Z"
about = "Y"
signals = ["T_front", "T_rear"]
"""


def warmed(model: Model, seed: int, hot: float, gain: float) -> Campaign:
    """A head that tilts by 20 µrad/K between front and rear, seen by two tools, noise 0.3 µm."""
    rng = np.random.default_rng(seed)
    rows = ['# format = "abbe-campaign/1"']
    rows.append("time,setup,kind,X,Y,Z,tool_z,ux,uy,uz,value,sd,T_front,T_rear")
    for k in range(40):
        t = 600.0 * k
        front, rear = hot * (1.0 - np.exp(-t / 9000.0)), 0.8 * hot * (1.0 - np.exp(-t / 6000.0))
        read = f"{20.0 + front * (1.0 + gain):.4f},{20.0 + rear:.4f}"
        for tool in (-80.0, -280.0):
            value = 1e3 * 20e-6 * (front - rear) * tool + rng.normal(0.0, 0.3)
            rows.append(f"{t},probe,displacement,200,200,200,{tool},1,0,0,{value:.4f},0.3,{read}")
    return as_campaign("\n".join(rows) + "\n", model)


def test_one_thermometer_that_reads_wrong_is_no_change_of_the_machine_besides() -> None:
    """Else the tilt by the difference has changed, and a tilt by the rear alone is missing."""
    model = parse_model(TomlSource(MODEL))
    fitted = fit(model, warmed(model, 1, 15.0, 0.0)).model
    found = diagnose(fitted, warmed(model, 2, 25.0, 0.08))
    assert found.verdict == "missing"
    assert found.standing is not None
    assert not found.standing.changes
    (cause,) = found.established
    named = {cause.effect.spec, *(a.found.candidate.effect.spec for a in cause.aliases)}
    assert "T_front" in cause.effect.spec
    assert "sensor_gain signal=T_front" in named
