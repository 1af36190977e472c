"""Holes on a bowl: motions that cancel are said to, and are not where the axes move apart."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.effects import make_effect
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.fitting.cancelling import cancel_lines, cancelling
from abbe.compcore.fitting.cautious import cautiously
from abbe.compcore.fitting.fit import fit
from benchmarks.hidden.judging import trial

MILL = parse_model(
    TomlSource(
        'format = "abbe-model/1"\n[machine]\nname = "mill"\nstructure = "w b X Y Z t"\n'
        "[machine.axes.X]\ntravel = [0.0, 400.0]\n[machine.axes.Y]\ntravel = [-100.0, 100.0]\n"
        "[machine.axes.Z]\ntravel = [-110.0, -80.0]\n"
    )
).with_effects(
    make_effect("positioning", {"axis": "X", "shape": "spline:8"}),
    make_effect("angular", {"axis": "X", "about": "Y", "shape": "spline:8"}),
)


def holes(*, bowl: bool, seed: int) -> Campaign:
    """Errors along X in one plate: a slow wave, 8 µm of a plate that bulges, 2 µm of noise.

    On the bowl an angular motion says the bulge by the little that Z rises with Y, and what it
    says of Z that rises with X the positioning takes back.
    """
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(20.0, 380.0, 300), rng.uniform(-100.0, 100.0, 300)
    z = -85.0 - (x**2 + y**2) / 8000.0 if bowl else rng.uniform(-110.0, -80.0, 300)
    error = 4.0 * np.sin(x / 60.0) + 8.0 * (x / 400.0) * (y / 100.0) ** 2
    error += rng.normal(0.0, 2.0, 300)
    head = ['# format = "abbe-campaign/1"', "setup,kind,X,Y,Z,ux,uy,uz,value"]
    rows = [
        f"plate,displacement,{a:.3f},{b:.3f},{c:.3f},1,0,0,{e:.2f}"
        for a, b, c, e in zip(x, y, z, error, strict=True)
    ]
    return trial.as_campaign("\n".join(head + rows) + "\n", MILL)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_motions_that_cancel_on_a_bowl_are_said_to(seed: int) -> None:
    result = fit(MILL, holes(bowl=True, seed=seed))
    whole, large = cancelling(result)
    assert 2.0e-3 < whole < 5.0e-3
    assert [spec.split()[0] for spec, _ in large] in (
        ["positioning", "angular"],
        ["angular", "positioning"],
    )
    assert large[1][1] > 3.0 * whole
    (line,) = cancel_lines(result)
    assert line.startswith("CANCEL: ")
    assert "positioning axis=X" in line
    assert "angular axis=X about=Y" in line
    assert line in list(result.words())
    # what the advice leads to
    assert not list(cancel_lines(cautiously(result)))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_nothing_cancels_where_the_axes_move_apart(seed: int) -> None:
    assert not list(cancel_lines(fit(MILL, holes(bowl=False, seed=seed))))
