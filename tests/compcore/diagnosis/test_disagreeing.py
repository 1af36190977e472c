"""Set-ups that disagree with all others are named, where no cause explains what is left."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from abbe.compcore.campaign.named_alike import named_alike
from abbe.compcore.diagnosis.disagreeing import disagreeing
from abbe.compcore.effects import Backlash, Positioning
from abbe.compcore.fitting.detail import finer
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term
from benchmarks.hidden.judging.trial import as_campaign

AXES = {a: Axis(a, (0.0, 500.0)) for a in "XYZ"}
MACHINE = Machine("m", Structure.parse("w b X Y Z t"), AXES, {})
MODEL = Model(MACHINE, (Term(Positioning(axis="X", shape="polynomial:2")),))


def lines(wrong: float, stated: bool = True):
    """Four lines along X by a laser, two by a gauge whose form is not what was said, µm."""
    rng = np.random.default_rng(5)
    rows = ['# format = "abbe-campaign/1"', "setup,kind,X,Y,Z,X_dir,ux,uy,uz,value,sd"]
    for name in ("laser1", "laser2", "laser3", "laser4", "gauge1", "gauge2"):
        for x in np.linspace(0.0, 500.0, 21):
            value = 4.0 * (x / 500.0) ** 2 + rng.normal(0.0, 0.3)
            value += wrong * np.sin(x / 30.0) if name.startswith("g") else 0.0
            rows.append(
                f"{name},displacement,{x},0,0,1,1,0,0,{value:.3f},{'0.3' if stated else ''}"
            )
    return as_campaign("\n".join(rows) + "\n", MODEL)


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize(("wrong", "said"), [(3.0, "gauge1, gauge2. Without"), (0.0, "")])
def test_a_gauge_that_disagrees_is_named(wrong: float, said: str, stated: bool):
    """Also where nobody stated an uncertainty: χ² is then the degrees of freedom of each fit."""
    whole = fit(MODEL, lines(wrong, stated))
    assert whole.uncertainty.open != stated
    found = SimpleNamespace(verdict="unexplained", whole=whole)
    text = " ".join(str(line) for line in disagreeing(found))
    assert (said in text) if said else text == ""


def test_names_that_begin_alike_are_one_gauge():
    groups = named_alike(["Y1_Y", "Y2_Y", "gX0", "gD22", "plH0", "plV0", "alone"])
    assert ("gX0", "gD22") in groups
    assert ("plH0", "plV0") in groups
    assert ("Y1_Y", "Y2_Y") in groups
    assert not any("alone" in g for g in groups)


def test_a_play_is_a_straight_line_before_it_is_a_table():
    details = [d["shape"] for d in finer(Backlash(axis="X"), lines(0.0).conditions, MACHINE)]
    assert details[:2] == ["polynomial:1", "polynomial:2"]
    assert details[-1] == "table"
