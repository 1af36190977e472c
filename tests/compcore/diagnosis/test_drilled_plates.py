"""Plates drilled by a mill and measured by a CMM: the names of its errors, wherever one begins."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.comparison.compare import compare
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging.trial import as_campaign

MILL = """format = "abbe-model/1"
[machine]
name = "mill"
structure = "w X' Y' b Z t"
[machine.axes.X]
travel = [0.0, 500.0]
[machine.axes.Y]
travel = [0.0, 400.0]
[machine.axes.Z]
travel = [-400.0, 0.0]
"""

SCALES = '[[effects]]\nkind = "scale"\naxis = "X"\n[[effects]]\nkind = "scale"\naxis = "Y"\n'

NOISE = 2.0


def drilled(model: Model, names: str, seed: int) -> Campaign:
    """Plates, one at each name, put anywhere on the table; µm; the order of holes is not known."""
    rng = np.random.default_rng(seed)
    rows = ['# format = "abbe-campaign/1"', '# instrument = "CMM"']
    rows += [f'# [setups.{name}]\n# free = ["frame"]' for name in names]
    rows.append("setup,kind,X,Y,Z,ux,uy,uz,value")
    for name in names:
        x, y = (g.ravel() for g in np.meshgrid(np.linspace(0, 320, 9), np.linspace(0, 240, 7)))
        x, y = x + rng.uniform(20.0, 160.0), y + rng.uniform(20.0, 140.0)
        u, v = x / 250.0 - 1.0, y / 200.0 - 1.0
        ex = 20.0 * (u**3 - u) + 8.0 * np.sin(x / 40.0) + 14.0 * v**2 - 25e-3 * u**2 * (y - 200.0)
        ey = 18.0 * (v**3 - v) + 15.0 * u**3 + 30e-3 * (x - 250.0)
        turned, (ox, oy) = rng.normal(0.0, 50e-3), rng.normal(0.0, 30.0, 2)
        ex, ey = ex + ox - turned * (y - y.mean()), ey + oy + turned * (x - x.mean())
        for unit, error in (("1,0,0", ex), ("0,1,0", ey)):
            read = error + rng.normal(0.0, NOISE, len(x))
            rows += [
                f"{name},displacement,{a:.3f},{b:.3f},-200,{unit},{e:.2f}"
                for a, b, e in zip(x, y, read, strict=True)
            ]
    return as_campaign("\n".join(rows) + "\n", model)


@pytest.mark.parametrize("start", ["", SCALES], ids=["bare", "scales"])
def test_a_mill_is_named_by_its_own_motions(start: str) -> None:
    """With one tool length a turn about X shifts Y, and a sag's slope stretches X: neither is.

    Before, the first names from nothing were a turn of Y about X, a turn of one axis by where
    another stands, and a table that sags sideways.
    """
    model = parse_model(TomlSource(MILL + start))
    course = to_the_verdict(model, drilled(model, "ab", 5))
    found = course.last.result.model
    specs = {e.spec for e in found.effects}
    assert {"positioning axis=X", "straightness axis=X direction=Y"} <= specs
    assert "straightness axis=Y direction=X" in specs
    allowed = {"positioning", "straightness", "angular", "squareness", "scale"}
    assert {e.kind for e in found.effects} <= allowed
    assert {s for s in specs if s.startswith("angular")} <= {"angular axis=X about=Z"}
    left = compare(found, drilled(model, "c", 6)).lengths.rms * 1e3
    assert left < 1.5 * NOISE
