"""Single compensations switched in the model file: what is applied, and what is not."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.effects import ScaleExpansion, Straightness
from abbe.compcore.errors import InputError
from abbe.compcore.files.model_file import load_model, save_model
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from abbe.compcore.model.uncertainty import uncertainty
from tests.support.compcore.five_axis import CODES, errors_of, machine_of, model_of, somewhere

STRUCTURE = Structure.parse("w b Y X Z t")
MACHINE = Machine("three", STRUCTURE, {a: Axis(a, (0.0, 500.0)) for a in "XYZ"}, {"T": Signal("T")})
GROWS = Term(ScaleExpansion(axis="X", signals=("T",)), {"alpha": Value(1e-5, 1e-7)})
BENDS = Term(Straightness(axis="X", direction="Y", shape="constant"), {"value": Value(3e-3, 1e-4)})
MODEL = Model(MACHINE, (GROWS, BENDS), covariance=np.diag([1e-14, 1e-8]))
AT = Conditions.at({"X": 200.0, "Y": 10.0, "Z": 20.0}, signals={"T": 25.0})


def error(model):
    return [float(v[0]) for v in model.axis_error(AT).values()]


def test_what_is_off_is_not_applied_and_the_rest_is():
    assert error(MODEL) == pytest.approx([200.0 * 1e-5 * 5.0, 3e-3, 0.0])
    off = MODEL.with_switch("scale_expansion", "off")
    assert error(off.switched()) == pytest.approx([0.0, 3e-3, 0.0])
    assert error(off.switched("off")) == pytest.approx([0.01, 0.0, 0.0])
    assert off.switched().signals_needed() == ()
    assert off.with_switch("scale_expansion axis=X", "on") == MODEL
    assert MODEL.switched() is MODEL


def test_the_uncertainty_is_that_of_what_is_applied():
    off = MODEL.with_switch("scale_expansion", "shown").switched()
    sure = uncertainty(off, AT)
    assert sure is not None
    assert sure.translation[0] == pytest.approx([0.0, 1e-4, 0.0])


def test_a_model_file_says_it_and_says_nothing_where_all_is_on(tmp_path):
    save_model(MODEL, tmp_path / "on.toml")
    assert "switch" not in (tmp_path / "on.toml").read_text()
    shown = MODEL.with_switch("straightness", "shown")
    save_model(shown, tmp_path / "shown.toml")
    assert load_model(tmp_path / "shown.toml") == shown
    text = (tmp_path / "shown.toml").read_text().replace('"shown"', '"sometimes"')
    (tmp_path / "bad.toml").write_text(text)
    with pytest.raises(InputError, match='not a switch.*"on", "off" or "shown"') as caught:
        load_model(tmp_path / "bad.toml")
    assert caught.value.line is not None


def test_one_table_of_a_grid_is_switched_alone(tmp_path):
    machine = machine_of(CODES["mixed"])
    errors = errors_of(machine)
    model = model_of(machine, errors)
    cut = {a: v.copy() for a, v in errors.items()}
    cut["X"][4] = 0.0  # E_BX
    at = Conditions.at(somewhere(machine, 9), tool=(0.0, 0.0, -100.0))
    off = model.with_switch("error_grid", "off", "E_BX")
    expected = model_of(machine, cut).predict(at)
    np.testing.assert_allclose(
        off.switched().predict(at).translation, expected.translation, atol=1e-15
    )
    save_model(off, tmp_path / "off.toml")
    again = load_model(tmp_path / "off.toml")
    assert again.switches == {
        "error_grid file=five-axis.grid.json": "on",
        "error_grid file=five-axis.grid.json E_BX": "off",
    }
    np.testing.assert_allclose(
        again.switched().predict(at).translation,
        off.switched().predict(at).translation,
        atol=1e-11,  # positions of rotary axes stand in degrees in the file
    )
    with pytest.raises(InputError, match="no such table"):
        model.with_switch("error_grid", "off", "E_BQ")
    with pytest.raises(InputError, match="no such table"):
        MODEL.with_switch("straightness", "off", "E_YX")


def test_a_name_that_is_none_or_two_is_refused():
    with pytest.raises(InputError, match="no effect is called that"):
        MODEL.with_switch("backlash", "off")
    with pytest.raises(InputError, match="more than one"):
        MODEL.with_switch("s", "off")
