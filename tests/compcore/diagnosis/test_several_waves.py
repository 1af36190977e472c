"""A rack has two waves: its pinion's turn and its teeth. The second is named as a cause as well."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.diagnosis import diagnose
from abbe.compcore.diagnosis.screening.candidates import candidates
from abbe.compcore.effects import Cyclic
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term
from benchmarks.hidden.judging.trial import as_campaign

RACK = Machine(
    "rack",
    Structure.parse("w b X Y Z t"),
    {"X": Axis("X", (0.0, 6000.0)), "Y": Axis("Y", (0.0, 900.0)), "Z": Axis("Z", (0.0, 900.0))},
    {},
)
PINION, TOOTH = 400.0, 10.0


@pytest.fixture(scope="module")
def campaign():
    """X along its travel in uneven steps, and 45 mm of it every 1.5 mm."""
    rng = np.random.default_rng(3)
    coarse = np.linspace(0.0, 6000.0, 97) + rng.uniform(-20.0, 20.0, 97)
    at = np.concatenate([np.clip(coarse, 0.0, 6000.0), 2000.0 + np.arange(0.0, 45.1, 1.5)])
    line = np.where(np.arange(len(at)) < 97, "whole", "fine")
    error = 9.0 * np.sin(2.0 * np.pi * at / PINION + 0.8) + 2.2 * np.cos(2.0 * np.pi * at / TOOTH)
    value = error + rng.normal(0.0, 0.4, len(at))
    rows = ['# format = "abbe-campaign/1"', "setup,kind,X,Y,Z,ux,uy,uz,value"]
    rows += [
        f"{s},displacement,{x:.4f},0,0,1,0,0,{v:.3f}"
        for s, x, v in zip(line, at, value, strict=True)
    ]
    return as_campaign("\n".join(rows) + "\n", Model(RACK, ()))


def test_the_teeth_are_named_beside_the_pinion(campaign):
    found = diagnose(Model(RACK, (Term(Cyclic(axis="X")),)), campaign)
    assert [e.effect.spec for e in found.established] == ["cyclic axis=X number=2"]
    (period,) = [e for e in found.established[0].estimates if e.name == "period"]
    assert period.value == pytest.approx(TOOTH, abs=0.01)


def test_a_wave_that_is_there_is_no_second_one(campaign):
    fitted = fit(Model(RACK, (Term(Cyclic(axis="X")),)), campaign).model
    second = [c for c in candidates(fitted, campaign) if c.effect.spec == "cyclic axis=X number=2"]
    (tried,) = [[c["period"] for c in candidate.choices] for candidate in second]
    away = np.abs(1.0 / np.array(tried) - 1.0 / PINION) * 6000.0
    assert away.min() >= 2.0
    assert TOOTH in tried


@pytest.mark.parametrize(("axis", "longest"), [("X", 500.0), ("Y", 112.5)])
def test_a_pinion_turns_many_times_in_the_travel(axis, longest):
    (period,) = Cyclic(axis=axis).nonlinear(RACK)
    assert period.plausible[1] == longest
