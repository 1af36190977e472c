"""What the last fit cannot tell from nothing does not stay in a model."""

from __future__ import annotations

import pytest

from abbe.compcore.diagnosis.judging.soundness import told_from_nothing
from abbe.compcore.effects import make_effect
from abbe.compcore.files.model_file import parse_model
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.model.model import Model, Term, Value

MACHINE = parse_model(
    TomlSource(
        'format = "abbe-model/1"\n[machine]\nstructure = "w b X Z t"\n'
        "[machine.axes.X]\ntravel = [0.0, 500.0]\n[machine.axes.Z]\ntravel = [-300.0, 0.0]\n"
        '[machine.signals.T]\nunit = "degC"\n'
    )
).machine


@pytest.mark.parametrize(("k", "sd", "told"), [(0.014, 0.014, False), (0.0124, 0.0039, True)])
def test_a_shift_of_one_uncertainty_is_none(k: float, sd: float, told: bool) -> None:
    effect = make_effect("thermal_offset", {"direction": "X", "signal": "T", "tau": "fit"})
    values = {"k": Value(k, sd), "tau": Value(80.0, 15.0)}
    assert told_from_nothing(Model(MACHINE, (Term(effect, values),)), effect) == told


def test_of_a_curve_no_single_coefficient_says_anything() -> None:
    effect = make_effect("positioning", {"axis": "X", "shape": "spline:8"})
    values = {p.name: Value(0.001, 0.002) for p in effect.linear(MACHINE)}
    assert told_from_nothing(Model(MACHINE, (Term(effect, values),)), effect)
