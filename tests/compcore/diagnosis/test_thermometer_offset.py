"""A thermometer that is off by a constant is one cause, not as many as scales read it."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect
from benchmarks.hidden.judging import trial

MACHINE = """format = "abbe-model/1"
[machine]
name = "bridge"
structure = "w b Y X Z t"
[machine.axes.X]
travel = [0.0, 700.0]
[machine.axes.Y]
travel = [0.0, 900.0]
[machine.axes.Z]
travel = [0.0, 500.0]
[machine.signals.T]
unit = "degC"
role = "scale"
"""
HEAD = '# format = "abbe-campaign/1"\n'
PPM = {"X": 16.0, "Y": 9.0, "Z": 5.0}
"""What each scale truly grows, ppm/K; warm from 21 to 22 °C only, so their parts seem alike."""


def lines(seed: int, offset: float, points: int) -> tuple[Model, Campaign]:
    """Three laser lines again and again while the scales warm; their thermometer reads too much."""
    rng = np.random.default_rng(seed)
    model = parse_model(TomlSource(MACHINE))
    for axis in PPM:
        model, _ = with_effect(model, "scale_expansion", {"axis": axis, "signals": "T"})
    head, rows = [], []
    for k in range(12):
        for a, axis in enumerate("XYZ"):
            name = f"{axis}{k}"
            head.append(f'# [setups.{name}]\n# free = ["zero"]\n')
            end = {"X": 680.0, "Y": 880.0, "Z": 480.0}[axis]
            at = [350.0, 450.0, 250.0]
            for q in np.linspace(20.0, end, points):
                t = 1800.0 * k + 600.0 * a + q / 5.0
                true = 21.5 + 0.5 * np.sin(t / 4000.0)
                at[a] = q
                # to first order, as a scale that is longer shows less than is there
                value = 1e-3 * PPM[axis] * (true - 20.0) * q + rng.normal(0.0, 0.5)
                u = ["1,0,0", "0,1,0", "0,0,1"][a]
                xyz = ",".join(f"{v:.3f}" for v in at)
                rows.append(
                    f"{t:.1f},{name},displacement,{xyz},{u},{value:.4f},{true + offset:.4f},0.5\n"
                )
    columns = "time,setup,kind,X,Y,Z,ux,uy,uz,value,T,sd\n"
    return model, trial.as_campaign(HEAD + "".join(head) + columns + "".join(rows), model)


@pytest.mark.parametrize(("seed", "points"), [(1, 15), (2, 15), (3, 300)])
def test_one_thermometer_is_named_instead_of_three_scales(seed: int, points: int) -> None:
    """Also of a campaign of which causes are told apart on a part of the rows."""
    model, campaign = lines(seed, 1.1, points)
    found = diagnose(model, campaign)
    assert (found.result is not found.whole) == (points == 300)
    assert [e.effect.spec for e in found.established] == ["sensor_offset signal=T"]
    (offset,) = found.established[0].estimates
    assert offset.value == pytest.approx(1.1, abs=4.0 * offset.sd)
    assert offset.sd < 0.1
    assert found.left == pytest.approx(1.0, abs=0.15)


def test_a_sound_thermometer_is_not_accused() -> None:
    model, campaign = lines(4, 0.0, 15)
    assert diagnose(model, campaign).verdict == "complete"
