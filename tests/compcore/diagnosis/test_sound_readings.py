"""What a thermometer or a warm body cannot have done is no cause; where an encoder counts from is.

Truths are drawn here and written as a shop's file, so that sizes are known.
"""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect
from benchmarks.hidden.judging import trial

HEAD = 'format = "abbe-model/1"\n[machine]\nname = "one place"\n'
PRINTER = f"""{HEAD}structure = "w b Z t"
[machine.axes.Z]
travel = [0.0, 250.0]
[machine.signals.bed]
unit = "degC"
role = "workpiece"
"""
ARM = f"""{HEAD}structure = "w b C t"
[machine.axes.C]
travel = [-90.0, 90.0]
"""


def campaign(model: Model, columns: str, rows: list[str], free: str = '["zero"]') -> Campaign:
    head = f'# format = "abbe-campaign/1"\n# [setups.s]\n# free = {free}\n{columns}\n'
    return trial.as_campaign(head + "\n".join(rows) + "\n", model)


def heated(moved: np.ndarray, shown: np.ndarray, t: np.ndarray) -> tuple[Model, Campaign]:
    """One place that moves by so many µm while the bed's thermometer shows what it shows."""
    model = parse_model(TomlSource(PRINTER))
    rows = [
        f"{a:.1f},s,displacement,0,0,0,1,{b:.3f},{c:.3f}"
        for a, b, c in zip(t, moved, shown, strict=True)
    ]
    return model, campaign(model, "time,setup,kind,Z,ux,uy,uz,value,bed", rows)


def warming(n: int = 180) -> tuple[np.ndarray, np.ndarray]:
    """Time, s, and a bed that is heated to 75 °C and cools again."""
    t = 15.0 * np.arange(n)
    up = 25.0 + 50.0 * (1.0 - np.exp(-t / 250.0))
    down = 25.0 + 50.0 * np.exp(-(t - 1600.0) / 700.0)
    return t, np.where(t < 1600.0, up, down)


def test_a_bent_thermometer_is_named() -> None:
    t, bed = warming()
    noise = np.random.default_rng(4).normal(0.0, 0.5, len(t))
    bend = 8e-4
    model, measured = heated(2.0 * (bed - 20.0) + noise, bed + bend * (bed - 20.0) ** 2, t)
    known, _ = with_effect(model, "thermal_offset", {"direction": "Z", "signal": "bed"})
    (found,) = diagnose(known, measured).established
    assert found.effect.spec == "sensor_bend signal=bed"
    more, _ = with_effect(known, "sensor_bend", {"signal": "bed"})
    result = fit(more, measured)
    value = result.model.terms[-1].values["bend"]
    assert value.sd is not None
    assert abs(value.value - bend) < 4.0 * value.sd
    assert result.chi2 / result.dof < 1.3


def test_what_no_thermometer_does_is_not_said_of_one() -> None:
    """A circuit that errs with the square of the temperature, twenty times what constants do."""
    t, bed = warming()
    noise = np.random.default_rng(5).normal(0.0, 0.5, len(t))
    model, measured = heated(0.2 * (bed - 20.0) - 0.02 * (bed - 30.0) ** 2 + noise, bed, t)
    steps = to_the_verdict(model, measured).last.result.model.effects
    assert "sensor_bend" not in {e.kind for e in steps}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_body_begins_where_one_can_have_been(seed: int) -> None:
    """What dies away as a body does, but a hundred times what its warmth could move."""
    t, bed = warming()
    noise = np.random.default_rng(seed).normal(0.0, 0.5, len(t))
    lagged = np.empty(len(t))
    lagged[0] = bed[0]
    for i in range(1, len(t)):
        lagged[i] = bed[i] + (lagged[i - 1] - bed[i]) * np.exp(-15.0 / 900.0)
    model, measured = heated(0.5 * (lagged - 20.0) + 300.0 * np.exp(-t / 900.0) + noise, bed, t)
    for effect in to_the_verdict(model, measured).last.result.model.effects:
        assert getattr(effect, "start", None) is None


def test_an_encoder_counts_from_anywhere() -> None:
    """A joint that stands 28 degrees beside its zero, with an eccentric ring."""
    model = parse_model(TomlSource(ARM))
    rng = np.random.default_rng(6)
    angle = np.linspace(-85.0, 85.0, 120)
    value = 488692.0 + 2000.0 * np.sin(np.deg2rad(angle)) + rng.normal(0.0, 20.0, len(angle))
    rows = [f"s,rotation,{a:.3f},0,0,1,{v:.1f}" for a, v in zip(angle, value, strict=True)]
    measured = campaign(model, "setup,kind,C,ux,uy,uz,value", rows, free="[]")
    diagnosis = diagnose(model, measured)
    found = next(e for e in diagnosis.established if e.effect.kind == "rotary_location")
    zero = next(p for p in found.estimates if p.name == "E_C0C")
    assert abs(zero.value - 0.4887) < 0.01
    assert zero.plausible
    assert found.found.doubt == 0.0
