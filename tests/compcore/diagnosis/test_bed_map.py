"""A bed touched by the head that travels over it: causes first, what they lack described beside."""

from __future__ import annotations

import numpy as np

from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from benchmarks.hidden.judging import trial

GANTRY = parse_model(
    TomlSource(
        'format = "abbe-model/1"\n[machine]\nname = "gantry"\nstructure = "w b Y X t"\n'
        "[machine.axes.X]\ntravel = [0.0, 310.0]\n[machine.axes.Y]\ntravel = [0.0, 310.0]\n"
    )
)


def touched(seed: int) -> str:
    """Twenty by twenty places, µm: both guideways bow, the gantry rolls, and the bed is wavy."""
    rng = np.random.default_rng(seed)
    rows = ['# format = "abbe-campaign/1"', "setup,kind,X,Y,ux,uy,uz,value"]
    for y in np.linspace(20.0, 280.0, 20):
        for x in np.linspace(20.0, 280.0, 20):
            guides = 60.0 * np.sin(x / 90.0) + 50.0 * np.cos(y / 110.0)
            roll = 0.4 * np.sin(y / 100.0) * (x - 150.0)
            bed = 14.0 * np.sin(np.pi * x / 300.0) ** 2 * np.sin(np.pi * y / 300.0) ** 2
            noise = rng.normal(0.0, 3.0)
            rows.append(f"bed,displacement,{x:g},{y:g},0,0,1,{guides + roll + bed + noise:.3f}")
    return "\n".join(rows) + "\n"


def test_causes_stay_beside_what_describes_the_rest() -> None:
    """A polynomial over the bed took the place of all three, a straightness against it."""
    course = to_the_verdict(GANTRY, trial.as_campaign(touched(3), GANTRY))
    found = [e.spec for e in course.last.result.model.effects]
    kinds = {spec.split(" shape")[0] for spec in found}
    assert {
        "straightness axis=X direction=Z",
        "straightness axis=Y direction=Z",
        "angular axis=Y about=Y",
    } <= kinds
    assert any(spec.startswith("formula") for spec in found)
    assert course.diagnosis.verdict == "complete"
