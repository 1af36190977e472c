"""A campaign at one place of the machine: what it cannot show stays small, however much is left."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.effects.registry import make_effect
from abbe.compcore.files.campaign_file import read_campaign
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.fitting.fit import fit
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from abbe.compcore.model.start_model import start_model

PRESS = Machine(
    "press",
    Structure.parse("w b Z t"),
    {"Z": Axis("Z", (0.0, 1.0))},
    {"load": Signal("load", "N", "load")},
)


def loaded(tmp_path: Path) -> Path:
    """Deflection under a load that rises and falls, the axis at rest: 5 mm at the greatest."""
    load = np.concatenate([np.linspace(0.0, 1e6, 10), np.linspace(1e6, 0.0, 10)])
    rows = [f"s,displacement,0,0,0,1,{x:.0f},{x * 5e-3 + 0.1 * (-1) ** i:.3f}"
            for i, x in enumerate(load)]  # fmt: skip
    file = tmp_path / "press.csv"
    head = '# format = "abbe-campaign/1"\nsetup,kind,Z,ux,uy,uz,load,value\n'
    file.write_text(head + "\n".join(rows) + "\n")
    return file


def test_what_one_place_cannot_show_is_left_alone(tmp_path: Path) -> None:
    campaign = read_campaign(loaded(tmp_path), PRESS)
    result = fit(start_model(PRESS), campaign)
    for term in result.model.terms:
        for value in term.values.values():
            assert abs(value.value) < 1e-6
    save_model(result.model, tmp_path / "fitted.toml")
    assert load_model(tmp_path / "fitted.toml").effects == result.model.effects


def test_one_place_without_a_clock_names_what_its_signal_does(tmp_path: Path) -> None:
    """All rows are of one place: they are left out by what was recorded there."""
    campaign = read_campaign(loaded(tmp_path), PRESS)
    last = to_the_verdict(Model(PRESS), campaign).last
    (effect,) = last.result.model.effects
    assert effect.spec == "load_bending axis=Z direction=Z signal=load shape=constant"
    assert last.held_out.lengths < 2e-4


def test_what_it_does_show_is_found(tmp_path: Path) -> None:
    campaign = read_campaign(loaded(tmp_path), PRESS)
    bends = make_effect(
        "load_bending", {"axis": "Z", "direction": "Z", "signal": "load", "shape": "constant"}
    )
    result = fit(Model(PRESS).with_effects(bends), campaign)
    (term,) = result.model.terms
    assert next(iter(term.values.values())).value == pytest.approx(5e-6, rel=1e-3)
