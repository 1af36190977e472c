from __future__ import annotations

import math
import re
import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from abbe.compcore.effects import make_effect
from abbe.compcore.errors import InputError
from abbe.compcore.files.model_file import (
    format_model,
    load_model,
    parse_model,
    save_model,
    summary,
)
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.machine import ROLES, Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value

TEXT = """\
format = "abbe-model/1"

[machine]
name = "Bridge CMM"
structure = "w b Y X Z t"          # ISO/TR 16907, 5.1
reference_temperature = 20.0       # °C

[machine.axes.X]
travel = [0.0, 700.0]              # mm (rotary: degrees)
[machine.axes.Y]
travel = [0.0, 900.0]
rotation_point = 12.5
[machine.axes.Z]
travel = [-360.0, 0.0]

[machine.signals.T_x]
unit = "degC"
role = "scale"
axis = "X"
location = "X scale, left end"

[[effects]]
kind = "positioning"
axis = "X"
shape = "spline:8"

[[effects]]
kind = "scale_expansion"
axis = "X"
signals = ["T_x"]
[effects.parameters.alpha]
value = 16.0
sd = 0.2
unit = "ppm/K"
"""


def read(text: str) -> Model:
    return parse_model(TomlSource(text, "m.toml"))


def test_what_the_format_says():
    model = read(TEXT)
    assert model.machine.name == "Bridge CMM"
    assert model.machine.structure == Structure.parse("w b Y X Z t")
    assert model.machine.axes["Z"].travel == (-360.0, 0.0)
    assert model.machine.axes["Y"].rotation_point == (0.0, 12.5, 0.0), "mm along the axis"
    assert model.machine.signals["T_x"] == Signal("T_x", "degC", "scale", "X", "X scale, left end")
    assert [t.effect.spec for t in model.terms] == [
        "positioning axis=X",
        "scale_expansion axis=X signals=T_x",
    ]
    assert not model.terms[0].fitted
    alpha = model.terms[1].values["alpha"]
    assert (alpha.value, alpha.sd) == pytest.approx((16e-6, 0.2e-6), rel=1e-15)
    assert model.composition == "first-order"


def test_rotary_travel_is_in_degrees():
    text = TEXT.replace("Z t", "Z C t") + "[machine.axes.C]\ntravel = [-180.0, 90.0]\n"
    assert read(text).machine.axes["C"].travel == (-math.pi, math.pi / 2)


def test_saved_and_loaded_again(tmp_path):
    path = tmp_path / "model.toml"
    save_model(read(TEXT), path)
    assert load_model(path) == read(TEXT)
    assert tomllib.loads(path.read_text())["format"] == "abbe-model/1"


finite = st.floats(allow_nan=False, allow_infinity=False)
names = st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc"]), max_size=12)
coordinate = st.floats(-2e5, 2e5)
vectors = st.tuples(coordinate, coordinate, coordinate)
ends = st.floats(-1e5, 1e5)
small = st.floats(-1e-2, 1e-2)
degrees = st.floats(-720.0, 720.0)
toml = st.one_of(st.integers(-(2**63), 2**63 - 1), finite, names, st.booleans())


@st.composite
def axes(draw, name):
    low, high = sorted(draw(st.lists(ends if name[0] not in "ABC" else degrees,
                                     min_size=2, max_size=2, unique=True)))  # fmt: skip
    if name[0] in "ABC":
        low, high = low * (math.pi / 180.0), high * (math.pi / 180.0)
    unit = math.pi / 180.0 if name[0] in "ABC" else 1.0
    if high - low < 1e-3 * unit:
        low, high = -1.0 * unit, 1.0 * unit
    return Axis(
        name,
        (low, high),
        rotation_point=draw(vectors),
        location=draw(vectors),
        error_acts=draw(st.sampled_from([None, "before", "after"])),
    )


@st.composite
def models(draw):
    rotary = draw(st.sampled_from([(), ("C",), ("A", "C")]))
    order = draw(st.permutations(["X", "Y", "Z", *rotary]))
    cut = draw(st.integers(0, len(order)))
    structure = Structure(tuple(order[:cut]), tuple(order[cut:]))
    signals = {
        name: Signal(
            name, draw(st.sampled_from(["degC", "K"])), draw(st.sampled_from(sorted(ROLES)))
        )
        for name in ("T_x", "T y", "T.z")
    }
    machine = Machine(
        draw(names), structure, {a: draw(axes(a)) for a in order}, signals, draw(st.floats(-20, 60))
    )
    linear = [a for a in order if a in "XYZ"]
    nodes = sorted(draw(st.lists(coordinate, min_size=2, max_size=5, unique=True)))
    catalogue = [
        ("positioning", {"axis": "X", "shape": "table", "positions": nodes}),
        ("straightness", {"axis": "X", "direction": "Y", "shape": "polynomial:3"}),
        ("angular", {"axis": "Z", "about": "Z"}),
        ("squareness", {"axes": linear[:2]}),
        ("scale_expansion", {"axis": "Y", "signals": ["T y", "T.z"], "tau": "fit"}),
        ("scale", {"axis": "Z"}),
    ]
    terms = []
    for kind, keys in draw(st.lists(st.sampled_from(catalogue), unique_by=lambda c: c[0])):
        effect = make_effect(kind, keys)
        drawn = {p.name: small for p in effect.linear(machine)}
        for p in effect.nonlinear(machine):
            drawn[p.name] = st.floats(1e-9, 1e-2) if p.bounds[0] > 0.0 else small
        sds = st.none() | st.floats(0.0, 1e-2)
        values = {name: Value(draw(value), draw(sds)) for name, value in drawn.items()}
        terms.append(Term(effect, values if draw(st.booleans()) else {}))
    size = sum(len(t.values) for t in terms)
    covariance = None
    if draw(st.booleans()):
        rng = np.random.default_rng(draw(st.integers(0, 1000)))
        matrix = rng.normal(size=(size, size))
        covariance = matrix @ matrix.T
        covariance = np.triu(covariance) + np.triu(covariance, 1).T
    record = st.dictionaries(
        names.filter(lambda n: n not in ("covariance", "n", "rms")), toml, max_size=3
    )
    history = tuple(draw(st.lists(record, max_size=2)))
    composition = draw(st.sampled_from(["first-order", "exact"]))
    return Model(machine, tuple(terms), composition, draw(record), history, covariance)


@given(models())
def test_round_trip_is_exact(model):
    text = format_model(model)
    again = parse_model(TomlSource(text))
    assert again == model
    assert format_model(again) == text


def test_a_direction_of_its_own_survives():
    slant = Axis("X", (0.0, 1.0), direction=(0.6, 0.8, 0.0))
    machine = Machine("slant bed", Structure.parse("w b X t"), {"X": slant})
    assert parse_model(TomlSource(format_model(Model(machine)))).machine == machine


def changed(old: str, new: str) -> str:
    assert TEXT.count(old) == 1, old
    return TEXT.replace(old, new)


ERRORS = [
    # (text, line, field, told)
    (changed('"abbe-model/1"', '"abbe-model/2"'), 1, "format", "found 'abbe-model/2'"),
    (TEXT.replace('format = "abbe-model/1"\n', "\n"), None, "format", "missing"),
    (changed("name =", "nmae ="), 4, "machine.nmae", "unknown key"),
    (changed("[machine.signals.T_x]", "[sensors.T_x]"), 16, "sensors", "unknown key"),
    (changed('structure = "w b Y X Z t" ', ""), 3, "machine.structure", "missing"),
    (changed("w b Y X Z t", "w b Y X Q t"), 5, "machine.structure", "cannot read 'Q'"),
    (changed("w b Y X Z t", "w b Y X Z W t"), None, "machine.axes.W", "has no section"),
    (changed("w b Y X Z t", "w b Y X t"), 13, "machine.axes.Z", "not in the structure code"),
    (changed("= 20.0 ", '= "warm" '), 6, "machine.reference_temperature", "found 'warm'"),
    (changed("= 20.0 ", "= nan "), 6, "machine.reference_temperature", "finite"),
    (changed("travel = [0.0, 700.0]", "travel = [700.0, 0.0]"), 9, "machine.axes.X.travel",
     "low < high"),
    (changed("travel = [0.0, 700.0]", "travel = [0.0]"), 9, "machine.axes.X.travel", ""),
    (changed("travel = [0.0, 700.0]", 'travel = [0.0, "far"]'), 9, "machine.axes.X.travel", "far"),
    (changed("travel = [0.0, 700.0] ", "travl = [0.0, 700.0] "), 8, "machine.axes.X.travel",
     "missing"),
    (changed("[machine.axes.Z]", "[machine.axes.Q]"), 13, "machine.axes.Q", "name of an axis"),
    (changed("rotation_point = 12.5", "rotation_point = [1, 2]"), 12,
     "machine.axes.Y.rotation_point", ""),
    (changed("rotation_point = 12.5", 'error_acts = "during"'), 12, "machine.axes.Y.error_acts",
     "found 'during'"),
    (changed('role = "scale"', 'role = "scael"'), 18, "machine.signals.T_x.role", "found 'scael'"),
    (changed('axis = "X"\nlocation', 'axis = "W"\nlocation'), 19, "machine.signals.T_x.axis",
     "found 'W'"),
    (changed('kind = "positioning"', 'kind = "positoning"'), 23, "effects[0].kind",
     "found 'positoning'"),
    (changed('kind = "positioning"\n', ""), 22, "effects[0].kind", "needs its kind"),
    (changed('axis = "X"\nshape', 'axis = "W"\nshape'), 24, "effects[0].axis", "found 'W'"),
    (changed("spline:8", "spline:0"), 25, "effects[0].shape", "found 'spline:0'"),
    (changed('shape = "spline:8"', 'shap = "spline:8"'), 25, "effects[0].shap", "no such key"),
    (changed('signals = ["T_x"]', 'signals = ["T_q"]'), 30, "effects[1].signals", "found 'T_q'"),
    (changed('signals = ["T_x"]\n', ""), 27, "effects[1].signals", "needs this key"),
    (changed("parameters.alpha", "parameters.beta"), 31, "effects[1].parameters.beta",
     "no such parameter"),
    (changed("value = 16.0\n", ""), 31, "effects[1].parameters.alpha.value", "missing"),
    (changed("value = 16.0", 'value = "much"'), 32, "effects[1].parameters.alpha.value",
     "found 'much'"),
    (changed("value = 16.0", "value = inf"), 32, "effects[1].parameters.alpha.value", "finite"),
    (changed("sd = 0.2", "sd = -0.2"), 33, "effects[1].parameters.alpha.sd", "found -0.2"),
    (changed("sd = 0.2", "sdd = 0.2"), 33, "effects[1].parameters.alpha.sdd", "unknown key"),
    (changed('"ppm/K"', '"µm"'), 34, "effects[1].parameters.alpha.unit", "found 'µm'"),
    (TEXT + '\n[[effects]]\nkind = "positioning"\naxis = "X"\nshape = "spline:8"\n', 36,
     "effects[2]", "the same effect twice"),
    (TEXT + '\n[[effects]]\nkind = "warm_up"\ndirection = "X"\n[effects.parameters]\n'
     'A = {value = 0.01}\ntau = {value = -600.0}\n', 41,
     "effects[2].parameters.tau.value", "found -600.0, expected above 0 s"),
    (TEXT + '\n[fit]\ncovariance = "rubbish"\n', 37, "fit.covariance", "damaged"),
    (changed("[machine]", "[machine"), 3, None, "not valid TOML"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "line", "field", "message"), ERRORS)
def test_every_error_names_file_line_and_key(text, line, field, message):
    with pytest.raises(InputError) as caught:
        read(text)
    error = caught.value
    assert error.file == "m.toml"
    if line is not None:
        assert error.line == line, str(error)
    if field is not None:
        assert error.field.startswith(field), str(error)
    assert message in str(error)
    assert "\n" not in str(error)


def test_loading_says_which_file(tmp_path):
    path = tmp_path / "broken.toml"
    path.write_text(changed("= 20.0 ", "= twenty "))
    with pytest.raises(InputError, match=re.escape(f"{path}, line 6: not valid TOML")):
        load_model(path)


def test_an_ancestors_record_keeps_what_matters():
    fit = {"date": "2026-01-01", "rms": 0.4, "covariance_note": "x", "n": 12}
    record = summary(Model(read(TEXT).machine, fit=fit))
    assert record == {"date": "2026-01-01", "rms": 0.4, "n": 12, "effects": 0}
