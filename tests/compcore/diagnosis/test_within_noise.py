"""What the last fit cannot tell from nothing does not stay in a model."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.diagnosis.judging.soundness import told_from_nothing
from abbe.compcore.diagnosis.stepwise.growing_model import GrowingModel
from abbe.compcore.diagnosis.stepwise.within_noise import take_out_noise
from abbe.compcore.effects import make_effect
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.model.model import Model, Term, Value
from abbe.compcore.model.revise import with_effect
from benchmarks.hidden.judging.trial import as_campaign

MACHINE = parse_model(
    TomlSource(
        'format = "abbe-model/1"\n[machine]\nstructure = "w b X Z t"\n'
        "[machine.axes.X]\ntravel = [0.0, 500.0]\n[machine.axes.Z]\ntravel = [-300.0, 0.0]\n"
        '[machine.signals.T]\nunit = "degC"\n'
    )
).machine


@pytest.mark.parametrize(("k", "sd", "told"), [(0.014, 0.014, False), (0.0124, 0.0039, True)])
def test_a_shift_of_one_uncertainty_is_none(k: float, sd: float, told: bool) -> None:
    effect = make_effect("thermal_offset", {"direction": "X", "signal": "T", "tau": "fit"})
    values = {"k": Value(k, sd), "tau": Value(80.0, 15.0)}
    assert told_from_nothing(Model(MACHINE, (Term(effect, values),)), effect) == told


def test_of_a_curve_no_single_coefficient_says_anything() -> None:
    effect = make_effect("positioning", {"axis": "X", "shape": "spline:8"})
    values = {p.name: Value(0.001, 0.002) for p in effect.linear(MACHINE)}
    assert told_from_nothing(Model(MACHINE, (Term(effect, values),)), effect)


@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_at_the_end_it_is_taken_out_and_what_is_real_stays(shift: float) -> None:
    """A line read eight times while it warms by 4 K: k = 0 or 3 µm/K, noise 0.5 µm."""
    rng = np.random.default_rng(2)
    rows = ['# format = "abbe-campaign/1"\n# [setups.l]\n# free = ["zero"]']
    rows.append("time,setup,kind,X,Z,ux,uy,uz,value,sd,T")
    for i in range(160):
        x, warm = 25.0 * (i % 20), 2.0 + 2.0 * np.sin(i / 30.0)
        value = 5.0 * (x / 500.0) ** 2 + shift * warm + rng.normal(0.0, 0.5)
        rows.append(f"{30 * i},l,displacement,{x:g},-100,1,0,0,{value:.3f},0.5,{20 + warm:.3f}")
    model, _ = with_effect(Model(MACHINE), "positioning", {"axis": "X", "shape": "polynomial:2"})
    model, offset = with_effect(model, "thermal_offset", {"direction": "X", "signal": "T"})
    campaign = as_campaign("\n".join(rows) + "\n", model)
    growing = GrowingModel(model, campaign, lambda _: None, lambda _: None)
    growing.added = [offset]
    assert take_out_noise(growing) == (shift == 0.0)
    assert (offset in growing.last.result.model.effects) == (shift != 0.0)
