"""A formula over the volume stood for the motions of the axes: it goes when these explain all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.stepwise.growing_model import GrowingModel
from abbe.compcore.diagnosis.stepwise.step import leaves_noise
from abbe.compcore.diagnosis.stepwise.whole_body import in_place_of
from abbe.compcore.diagnosis.uncatalogued.chosen import grown
from abbe.compcore.effects.registry import make_effect
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model
from abbe.compcore.fitting.fit import fit

BRIDGE = Path(__file__).parents[2] / "data" / "p02-bridge"
MOTIONS = ("positioning", "straightness", "angular")
TERMS = "X,Y,Z,X**2,X*Y,X*Z,Y**2,Y*Z,Z**2"


def test_motions_take_the_place_of_a_formula() -> None:
    """Beside each other they work against each other everywhere but at what was measured."""
    whole = load_model(BRIDGE / "model.toml")
    lost = [t for t in whole.terms if t.effect.kind in MOTIONS and t.effect.where()["axis"] == "X"]
    stand, missing = [t for t in whole.terms if t not in lost], [t.effect for t in lost]
    model = replace(whole, terms=tuple(stand))
    campaign = read_campaign(BRIDGE / "fit.csv", model.machine)
    campaign = campaign.rows(np.arange(0, campaign.n, 3))
    growing = GrowingModel(model, campaign, lambda _: None, lambda _: None)
    formulas = [make_effect("formula", {"channel": f"d{a}", "terms": TERMS}) for a in "XYZ"]
    more = grown(growing.last.result.model, formulas)
    result = fit(more[-1][0], campaign, near=True)
    growing.make_together("described", "described", more, result, LeftOutErrors.of(result))
    assert not leaves_noise(growing.last.result)
    assert in_place_of(growing, formulas, missing)
    effects = set(growing.last.result.model.effects)
    assert effects.isdisjoint(formulas)
    assert len(effects.intersection(missing)) >= 3
    assert leaves_noise(growing.last.result)
