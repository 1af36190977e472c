"""Encoders' zeros of 20 mrad: named alone, composed in full, nothing made of the rest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis import diagnose
from abbe.compcore.diagnosis.stepwise import to_the_verdict
from abbe.compcore.effects import RotaryLocation
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model
from benchmarks.hidden.judging.trial import as_campaign
from tests.compcore.diagnosis.test_named_first import about

F64 = NDArray[np.float64]

_SHOULDER = np.array([0.0, 0.0, 400.0])
_NOISE = 20.0


def arm(zero_c: float, zero_b: float) -> tuple[Model, Campaign]:
    """An arm of two joints before a tracker that knows where it stands; two tools, noise 20 µm."""
    rng = np.random.default_rng(15)
    text = ['format = "abbe-model/1"', "[machine]", 'name = "arm"', 'structure = "w b C B t"']
    text += ["[machine.axes.C]", "travel = [-170.0, 170.0]"]
    text += ["[machine.axes.B]", "travel = [-30.0, 120.0]", "location = [0.0, 0.0, 400.0]"]
    rows = ['# format = "abbe-campaign/1"', '# instrument = "tracker"']
    rows += ["# [setups.tracker]\n# free = []"]
    rows.append("setup,kind,C,B,tool_x,tool_y,tool_z,ux,uy,uz,value,sd")

    def place(c: float, b: float, tool: F64) -> F64:
        return np.asarray(about("Z", c) @ (_SHOULDER + about("Y", b) @ (tool - _SHOULDER)))

    for i in range(40):
        c, b = rng.uniform(-2.8, 2.8), rng.uniform(-0.35, 1.9)
        tool = np.array([0.0, 0.0, 500.0 + 150.0 * (i % 2)])
        error = 1e3 * (place(c + zero_c, b + zero_b, tool) - place(c, b, tool))
        at = f"{math.degrees(c):.9f},{math.degrees(b):.9f},0,0,{tool[2]}"
        for k, u in enumerate(("1,0,0", "0,1,0", "0,0,1")):
            value = error[k] + rng.normal(0.0, _NOISE)
            rows.append(f"tracker,displacement,{at},{u},{value:.4f},{_NOISE}")
    model = parse_model(TomlSource("\n".join(text)))
    return model, as_campaign("\n".join(rows) + "\n", model)


@pytest.mark.parametrize("zero_b", [0.0, -25e-3])
def test_zeros_of_encoders_are_all_that_is_named(zero_b: float) -> None:
    model, campaign = arm(20e-3, zero_b)
    found = diagnose(model, campaign)
    kinds = {e.effect.kind for e in found.established}
    assert kinds == {"rotary_location"}
    assert not found.structure
    for cause in found.established:
        assert all(e.plausible for e in cause.estimates)
    # beside the zero of C alone, the place of the line of B says what is left
    assert found.large_angles == (zero_b != 0.0)
    assert any("do not add up" in line for line in found.words()) == found.large_angles


@pytest.mark.parametrize("zero_b", [0.0, -25e-3])
def test_the_rest_of_large_angles_is_composed_and_not_explained(zero_b: float) -> None:
    """To first order 0.13 mm were left, and called a workpiece that is 400 ppm too large."""
    model, campaign = arm(20e-3, zero_b)
    course = to_the_verdict(model, campaign)
    last = course.last.result
    assert [s.action for s in course.steps].count("composed") == 1
    assert last.model.composition == "exact"
    assert {e.kind for e in last.model.effects} == {"rotary_location"}
    assert course.diagnosis.verdict == "complete"
    assert last.chi2_per_dof < 1.3
    values = {name: v for t in last.model.terms for name, v in t.values.items()}
    about_z = sum(v.value for name, v in values.items() if name in ("E_C0B", "E_C0C"))
    assert about_z == pytest.approx(20e-3, abs=1e-4)
    assert values["E_B0B"].value == pytest.approx(zero_b, abs=1e-4)


def test_small_angles_add_up() -> None:
    found = diagnose(*arm(2e-4, 0.0))
    assert not found.large_angles


@pytest.mark.parametrize(
    ("structure", "axis", "agreed"),
    [
        ("w b C B t", "B", {"E_B0B", "E_C0B"}),
        ("w b C B t", "C", {"E_C0C"}),
        ("w b C X B t", "B", {"E_B0B"}),
        ("w C' A' Y' b X Z t", "C", {"E_C0C", "E_A0C"}),
        ("w C' A' Y' b X Z t", "A", {"E_A0A"}),
    ],
)
def test_an_axis_turned_about_the_one_that_carries_it_is_that_ones_zero(
    structure: str, axis: str, agreed: set[str]
) -> None:
    code = Structure.parse(structure)
    machine = Machine("any", code, {a: Axis(a, (-90.0, 90.0)) for a in code.axes})
    parameters = RotaryLocation(axis=axis).linear(machine)
    assert {p.name for p in parameters if p.convention} == agreed
