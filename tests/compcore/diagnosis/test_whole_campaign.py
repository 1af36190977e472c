"""The instrument does not lead where nothing was measured without it; honest words; a free tool."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.diagnosis.screening.candidates import acts_everywhere, candidates
from abbe.compcore.effects import make_effect
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging.trial import as_campaign
from tests.compcore.diagnosis.test_named_first import about, sky

BOTH = Coverage(setups=("one", "two"), bases=("B1",))


@pytest.mark.parametrize(
    ("kind", "keys", "expected"),
    [
        ("instrument_drift", {"setup": "one"}, False),
        ("dead_path", {"setups": "one,two"}, True),
        ("length_bias", {}, True),
        ("length_bias", {"base": "B1"}, True),
        ("drift", {"direction": "X"}, False),
    ],
)
def test_which_causes_nothing_was_measured_without(
    kind: str, keys: dict[str, str], expected: bool
) -> None:
    assert acts_everywhere(make_effect(kind, keys), BOTH) is expected


def wandering(sd: float) -> tuple[Model, Campaign]:
    """One probe in one place for three hours, that wanders by 4 µm an hour."""
    rng = np.random.default_rng(2)
    text = 'format = "abbe-model/1"\n[machine]\nname = "m"\nstructure = "w b X Y Z t"\n'
    text += "".join(f"[machine.axes.{a}]\ntravel = [0.0, 400.0]\n" for a in "XYZ")
    rows = ['# format = "abbe-campaign/1"', '# instrument = "probe"', "# [setups.one]"]
    rows += ['# free = ["zero"]', "time,setup,kind,X,Y,Z,ux,uy,uz,value,sd"]
    for i in range(180):
        value = 4.0 * i / 60.0 + rng.normal(0.0, 0.3)
        rows.append(f"{60 * i},one,displacement,9,9,9,1,0,0,{value:.3f},{sd}")
    model = parse_model(TomlSource(text))
    return model, as_campaign("\n".join(rows) + "\n", model)


def test_a_drift_of_the_only_set_up_is_the_machines() -> None:
    model, campaign = wandering(0.3)
    tried = {c.effect.spec: c.everywhere for c in candidates(model, campaign)}
    assert tried["instrument_drift setup=one"]
    assert not tried["drift direction=X"]
    found = diagnose(model, campaign)
    assert found.established[0].effect.spec == "drift direction=X"


def test_what_is_more_than_was_stated_is_not_called_noise() -> None:
    rng = np.random.default_rng(3)
    model, campaign = wandering(0.3)
    for noise, word in (
        (0.3, "the residuals are noise"),
        (2.0, "more than the stated uncertainty"),
    ):
        white = replace(campaign, value=rng.normal(0.0, noise * 1e-3, campaign.n))
        found = diagnose(model, white)
        assert found.verdict == "complete"
        assert word in "\n".join(found.words())


def test_a_free_tool_on_a_machine_of_rotary_axes_only() -> None:
    from abbe.compcore.campaign.campaign import Tool

    model, campaign = sky(lambda c, b: about("Z", c) @ about("Y", b), 7, places=20)
    named = replace(
        campaign,
        tools={"T1": Tool("T1", (0.0, 0.0, 200.0), ("z",))},
        tool_name=np.full(campaign.n, "T1"),
    )
    result = fit(model, named)
    assert np.isfinite(result.theta).all()
