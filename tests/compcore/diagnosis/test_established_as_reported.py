"""What is reported as established is so beside all that is reported with it."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis.judging.established import standing_together
from abbe.compcore.diagnosis.verdict import diagnose
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging.trial import as_campaign

MODEL = """format = "abbe-model/1"
[machine]
name = "lathe"
structure = "w b Z t"
[machine.axes.Z]
travel = [0.0, 100.0]
"""
HEAD = '# format = "abbe-campaign/1"\n# [setups.a]\n# free = ["zero"]\n'


def moved(seed: int) -> tuple[Model, Campaign]:
    """A place that is read for five hours: it steps once, and creeps by about the noise."""
    rng = np.random.default_rng(seed)
    time = 120.0 * np.arange(150)
    after = np.arange(150) >= rng.integers(30, 120)
    value = rng.uniform(3.0, 8.0) * after + rng.uniform(0.5, 2.5) * time / time[-1]
    value += rng.normal(0.0, 1.0, len(time))
    rows = "".join(
        f"{t:.0f},a,displacement,0,0,0,1,{v:.3f}\n" for t, v in zip(time, value, strict=True)
    )
    model = parse_model(TomlSource(MODEL))
    return model, as_campaign(HEAD + "time,setup,kind,Z,ux,uy,uz,value\n" + rows, model)


@pytest.mark.parametrize("seed", [3, 7, 11])
def test_causes_are_established_beside_each_other(seed: int) -> None:
    found = diagnose(*moved(seed))
    assert found.established
    for cause in found.established:
        assert cause.found.established(found.basis.n)
        assert cause.found.evidence.p_value < 1e-4


def test_one_that_the_others_made_superfluous_goes() -> None:
    found = diagnose(*moved(7))
    chosen = [e.found for e in found.established]
    kinds = {f.candidate.effect.kind for f in chosen}
    assert kinds == {"event", "drift"}
    # beside an event and a drift a warm-up, which alone is beyond doubt, says nothing more
    (more,) = [f for f in found.ranked if f.candidate.effect.kind == "warm_up"][:1]
    assert more.established(found.basis.n)
    kept = standing_together(found.pool, found.basis, [*chosen, more])
    assert {f.candidate.effect.kind for f in kept} == kinds
