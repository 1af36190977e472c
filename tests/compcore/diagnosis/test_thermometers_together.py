"""Thermometers that say nothing one by one."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging.trial import as_campaign

MODEL = """format = "abbe-model/1"
[machine]
name = "printer"
structure = "w b Z t"
[machine.axes.Z]
travel = [0.0, 250.0]
[machine.signals.bed]
unit = "degC"
role = "workpiece"
[machine.signals.chamber]
unit = "degC"
role = "ambient"
"""
HEAD = '# format = "abbe-campaign/1"\n# [setups.pin]\n# free = ["zero"]\n'
NOISE = 1.0


def warmed(seed: int) -> tuple[Model, Campaign]:
    """A probe that is pushed up by the bed and down by the chamber, and is not quite straight."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 2800.0, 14.0)
    bed = 25.0 + 45.0 * np.clip(t / 500.0, 0.0, 1.0) - 30.0 * np.clip((t - 2100.0) / 700.0, 0, 1)
    chamber = 26.0 + 10.0 * (1.0 - np.exp(-t / 900.0))
    bend = ((bed - 50.0) / 20.0) * ((chamber - 31.0) / 5.0)
    value = 1.6 * bed - 6.0 * chamber + 6.0 * bend + rng.normal(0.0, NOISE, len(t))
    rows = [
        f"{s:.0f},pin,displacement,0,0,0,1,{v:.3f},{b:.2f},{c:.2f}\n"
        for s, v, b, c in zip(t, value - value[0], bed, chamber, strict=True)
    ]
    model = parse_model(TomlSource(MODEL))
    columns = "time,setup,kind,Z,ux,uy,uz,value,bed,chamber\n"
    return model, as_campaign(HEAD + columns + "".join(rows), model)


@pytest.mark.parametrize("seed", [1, 2])
def test_what_two_thermometers_say_together_is_found(seed: int) -> None:
    model, campaign = warmed(seed)
    last = to_the_verdict(model, campaign).last
    read = {s for e in last.result.model.effects for s in e.signals_needed()}
    assert read == {"bed", "chamber"}
    assert last.held_out.lengths < 0.3 * float(np.std(campaign.value))
