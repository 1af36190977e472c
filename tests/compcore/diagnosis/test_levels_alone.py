"""Who measured with levels alone is not sent for a laser to tell what levels tell."""

from __future__ import annotations

import numpy as np

from abbe.compcore.diagnosis import advise, diagnose
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from benchmarks.hidden.judging.trial import as_campaign


def test_next_are_angles():
    model = parse_model(
        TomlSource("""
format = "abbe-model/1"
[machine]
name = "mill"
structure = "w b X Y Z t"
axes.X.travel = [0.0, 800.0]
axes.Y.travel = [0.0, 600.0]
axes.Z.travel = [-500.0, 0.0]
[[effects]]
kind = "angular"
axis = "X"
about = "Y"
shape = "polynomial:2"
""")
    )
    rng = np.random.default_rng(1)
    rows = ['# format = "abbe-campaign/1"', "time,setup,kind,X,Y,Z,X_dir,ux,uy,uz,value"]
    for way in (1, -1):
        for x in np.linspace(0.0, 800.0, 17)[::way]:
            for k, u in ((1, "0,1,0"), (0, "1,0,0")):
                curve = (30.0, 25.0)[k] * ((x - 400.0) / 400.0) ** 2 + 8.0 * way * k
                value = curve + rng.normal(0.0, 0.8)
                rows.append(f"{10 * len(rows)},l{k},rotation,{x},300,-250,{way},{u},{value:.3f}")
    found = diagnose(model, as_campaign("\n".join(rows) + "\n", model))
    advice = [a.what for a in advise(found)]
    assert advice
    assert all(what.startswith("angle of") for what in advice), advice
