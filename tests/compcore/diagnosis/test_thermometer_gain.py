"""A thermometer that magnifies is named, where two effects that read it err for one reason."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.model.model import Model, Value
from abbe.compcore.model.revise import with_effect
from benchmarks.hidden.judging import trial

MACHINE = """format = "abbe-model/1"
[machine]
name = "column"
structure = "w b X Z t"
[machine.axes.X]
travel = [0.0, 500.0]
[machine.axes.Z]
travel = [0.0, 600.0]
[machine.signals.front]
unit = "degC"
role = "structure"
axis = "Z"
[machine.signals.rear]
unit = "degC"
role = "structure"
axis = "Z"
"""
HEAD = '# format = "abbe-campaign/1"\n# [setups.plate]\n# free = ["zero"]\n'
EFFECTS = (
    ("thermal_tilt", {"axis": "X", "about": "Y", "signals": "front,rear"}),
    ("thermal_bending", {"axis": "Z", "about": "Y", "signals": "front,rear", "deflection": "true"}),
)


def warm_column(seed: int, gain: float) -> tuple[Model, Campaign]:
    """A plate that is probed all day; the front's thermometer magnifies differences from 20 °C."""
    rng = np.random.default_rng(seed)
    n = 240
    t = 120.0 * np.arange(n)
    front = 24.0 + 3.0 * np.sin(t / 5000.0) + 0.8 * np.sin(t / 1300.0)
    rear = 23.5 + 2.6 * np.sin(t / 5000.0 - 0.15) + 0.5 * np.sin(t / 1700.0)
    x, z = rng.uniform(0.0, 500.0, n), rng.uniform(0.0, 600.0, n)
    model = parse_model(TomlSource(MACHINE))
    for kind, where in EFFECTS:
        model, _ = with_effect(model, kind, where)
    truth = model.with_values([{"k": Value(8e-6)}, {"kappa": Value(4e-8)}])
    at = Conditions.at({"X": x, "Z": z}, time=t, signals={"front": front, "rear": rear})
    moved = truth.predict(at).translation
    shown = 20.0 + (1.0 + gain) * (front - 20.0)
    rows = []
    for i in range(n):
        u = (1, 0, 0) if i % 2 else (0, 0, 1)
        value = 1e3 * float(moved[i] @ np.array(u)) + rng.normal(0.0, 0.5)
        rows.append(
            f"{t[i]:.0f},plate,displacement,{x[i]:.3f},{z[i]:.3f},{u[0]},{u[1]},{u[2]},{value:.3f},"
            f"{shown[i]:.3f},{rear[i]:.3f}\n"
        )
    columns = "time,setup,kind,X,Z,ux,uy,uz,value,front,rear\n"
    return model, trial.as_campaign(HEAD + columns + "".join(rows), model)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_thermometer_that_magnifies_is_named(seed: int) -> None:
    model, campaign = warm_column(seed, 0.15)
    (found,) = diagnose(model, campaign).established
    assert found.effect.kind == "sensor_gain"
    # of a difference nobody can say which of the two is wrong
    other = {a.found.candidate.effect.spec for a in found.aliases}
    both = {"sensor_gain signal=front", "sensor_gain signal=rear"}
    assert both <= other | {found.effect.spec}
    more, _ = with_effect(model, found.effect.kind, found.effect.where())
    result = fit(more, campaign)
    gain = result.model.terms[-1].values["gain"]
    assert gain.sd is not None
    true = 0.15 if found.effect.spec.endswith("front") else 1.0 / 1.15 - 1.0
    assert abs(gain.value - true) < 4.0 * gain.sd
    assert result.rms(Kind.DISPLACEMENT) < 0.55e-3


def test_sound_thermometers_are_not_accused() -> None:
    model, campaign = warm_column(3, 0.0)
    assert diagnose(model, campaign).verdict == "complete"
