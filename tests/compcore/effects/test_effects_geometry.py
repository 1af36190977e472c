"""The first six effects: their values against closed forms, and what they refuse."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Legendre

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects import (
    Angular,
    ErrorMotion,
    Positioning,
    Scale,
    ScaleExpansion,
    Squareness,
    Straightness,
    effect_class,
    effect_kinds,
    make_effect,
)
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain, first_order
from abbe.compcore.machine.lag import first_order_lag
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.model.model import Model, Term, Value
from tests.support.compcore.machines import machine

SIGNALS = {
    "T1": Signal("T1", role="scale", axis="X"),
    "T2": Signal("T2", role="scale", axis="X"),
    "T_amb": Signal("T_amb", role="ambient"),
    "load": Signal("load", unit="kg", role="load"),
}
BRIDGE = machine()
WARM = Machine("warm", BRIDGE.structure, BRIDGE.axes, SIGNALS, reference_temperature=20.0)
X = np.array([-50.0, 0.0, 100.0, 350.0, 700.0, 750.0])
AT = Conditions.at({"X": X, "Y": 450.0, "Z": -100.0})


def error_motion(effect, values, conditions=AT, m=BRIDGE):
    """{channel name: (n,)} of one fitted effect."""
    names = [p.name for p in (*effect.linear(m), *effect.nonlinear(m))]
    term = Term(effect, {n: Value(v) for n, v in zip(names, values, strict=True)})
    return {str(c): v for c, v in Model(m, (term,)).error_motions(conditions).items()}


def test_positioning_polynomial_is_a_legendre_series_over_the_travel():
    c = [0.010, -0.004, 0.002]
    found = error_motion(Positioning(axis="X", shape="polynomial:2"), c)
    expected = Legendre(c, domain=[0.0, 700.0])(np.clip(X, 0.0, 700.0))
    np.testing.assert_allclose(found.pop("E_XX"), expected, atol=1e-15)
    assert not found


def test_positioning_table_interpolates_and_holds_its_ends():
    effect = Positioning(axis="X", shape="table", positions=(0.0, 200.0, 600.0))
    found = error_motion(effect, [0.0, 0.002, -0.006])["E_XX"]
    np.testing.assert_allclose(found, [0.0, 0.0, 0.001, -0.001, -0.006, -0.006], atol=1e-15)


def test_scale_grows_evenly_and_is_held_beyond_the_travel():
    np.testing.assert_allclose(
        error_motion(Scale(axis="X"), [20e-6])["E_XX"],
        [0.0, 0.0, 0.002, 0.007, 0.014, 0.014],
        atol=1e-15,
    )


def test_straightness_and_angles_act_where_they_say():
    constant = error_motion(Straightness(axis="X", direction="Z", shape="constant"), [0.003])
    np.testing.assert_allclose(constant["E_ZX"], 0.003)
    spline = error_motion(Angular(axis="Y", about="Z", shape="spline:1"), [5e-6])
    np.testing.assert_allclose(spline["E_CY"], 5e-6)
    for about, letter in zip("XYZ", "ABC", strict=True):
        assert Angular(axis="X", about=about).component() == letter


def test_u_v_w_axes_err_along_their_own_direction():
    m = machine("w b X Y Z W t")
    c = Conditions.at(dict.fromkeys("XYZ", 0.0) | {"W": [10.0]})
    assert list(error_motion(Positioning(axis="W", shape="constant"), [1.0], c, m)) == ["E_ZW"]
    assert list(error_motion(Scale(axis="W"), [1e-6], c, m)) == ["E_ZW"]


def test_scale_expansion_is_alpha_x_dt():
    c = Conditions.at({"X": X, "Y": 0.0, "Z": 0.0}, signals={"T1": 21.0, "T2": 23.0})
    found = error_motion(ScaleExpansion(axis="X", signals=("T1", "T2")), [16e-6], c, WARM)
    expected = 16e-6 * np.clip(X, 0, 700) * ((21.0 + 23.0) / 2 - 20.0)
    np.testing.assert_allclose(found["E_XX"], expected, atol=1e-15)


def test_scale_expansion_may_lag_by_a_given_or_a_fitted_time():
    t = np.linspace(0.0, 3600.0, 6)
    temperature = 20.0 + 1e-3 * t
    c = Conditions(
        {"X": X, "Y": np.zeros(6), "Z": np.zeros(6)}, time=t, signals={"T1": temperature}
    )
    expected = 10e-6 * np.clip(X, 0, 700) * (first_order_lag(t, temperature, 900.0) - 20.0)
    given = ScaleExpansion(axis="X", signals=("T1",), tau=900.0)
    np.testing.assert_allclose(error_motion(given, [10e-6], c, WARM)["E_XX"], expected)
    fitted = ScaleExpansion(axis="X", signals=("T1",), tau="fit")
    np.testing.assert_allclose(error_motion(fitted, [10e-6, 900.0], c, WARM)["E_XX"], expected)


@pytest.mark.parametrize(
    ("code", "axes"),
    [
        ("w b Y X Z t", "YX"),
        ("w b Y X Z t", "YZ"),
        ("w b Y X Z t", "XZ"),
        ("w Z' b X Y t", "ZX"),
        ("w Z' b X Y t", "ZY"),
        ("w Z' b X Y t", "XY"),
        ("w Y' X' b Z t", "YX"),
        ("w Y' X' b Z t", "XZ"),
    ],
)
def test_squareness_is_seen_on_a_square(code, axes):
    """The angle between two axes' real directions changes by it, on either side of the bed."""
    first, second = axes
    angle, length = 40e-6, 300.0
    m = machine(code)
    term = Term(Squareness(axes=(first, second)), {"angle": Value(angle)})

    def displacement(axis):
        corners = Conditions.at({a: [0.0, length if a == axis else 0.0] for a in "XYZ"})
        error = Model(m, (term,)).predict(corners).translation
        return (error[1] - error[0]) / length

    u, v = (np.eye(3)["XYZ".index(a)] for a in axes)
    third = np.eye(3)["XYZ".index(next(iter(set("XYZ") - set(axes))))]
    # the second axis turns by +angle about the third direction against the first
    relative = np.dot(np.cross(third, v), displacement(second))
    relative -= np.dot(np.cross(third, u), displacement(first))
    assert relative == pytest.approx(angle, rel=1e-9)
    for other in set("XYZ") - set(axes):
        np.testing.assert_allclose(displacement(other), 0.0, atol=1e-15)


def test_squareness_on_the_tool_side_is_a_constant_of_the_first_axis():
    found = error_motion(Squareness(axes=("Y", "X")), [7e-6])
    np.testing.assert_allclose(found.pop("E_CY"), 7e-6)
    assert not found
    assert Squareness(axes=("Y", "X")).positions_used(BRIDGE) == ()


def test_squareness_of_a_workpiece_side_axis_turns_nothing_of_its_own():
    m = machine("w X' b Y Z t")
    term = Term(Squareness(axes=("X", "Y")), {"angle": Value(10e-6)})
    c = Conditions.at({"X": [0.0, 700.0], "Y": 100.0, "Z": 0.0})
    moved, turned = first_order(Chain(m, c), Model(m, (term,)).error_motions(c))
    np.testing.assert_allclose(moved, [[-0.001, 0.0, 0.0]] * 2, atol=1e-15)
    np.testing.assert_allclose(turned, [[0.0, 0.0, 10e-6]] * 2)
    assert term.effect.positions_used(m) == ("X",)


WRONG = [
    ("positioning", {}, "axis", "needs this key"),
    ("positioning", {"axis": "W"}, "axis", "no such axis"),
    ("positioning", {"axis": "X", "shape": "cubic"}, "shape", "unknown shape"),
    ("positioning", {"axis": "X", "shap": "table"}, "shap", "has no such key"),
    ("positioning", {"axis": "X", "shape": "table"}, "positions", "needs its positions"),
    ("positioning", {"axis": "C"}, "axis", "effect of linear axes"),
    ("scale", {"axis": "C"}, "axis", "effect of linear axes"),
    ("straightness", {"axis": "X"}, "direction", "needs this key"),
    ("straightness", {"axis": "X", "direction": "X"}, "direction", "across the axis"),
    ("straightness", {"axis": "X", "direction": "Q"}, "direction", "'X', 'Y' or 'Z'"),
    ("straightness", {"axis": "C", "direction": "X"}, "axis", "effect of linear axes"),
    ("angular", {"axis": "X", "about": "C"}, "about", "'X', 'Y' or 'Z'"),
    ("angular", {"axis": "C", "about": "X"}, "axis", "effect of linear axes"),
    ("squareness", {"axes": ["X", "Y"]}, "axes", "structure's order"),
    ("squareness", {"axes": ["Y", "Y"]}, "axes", "two directions"),
    ("squareness", {"axes": ["Y", "C"]}, "axes", "between linear axes"),
    ("squareness", {"axes": ["Y"]}, "axes", ""),
    ("squareness", {"axes": "Y,W"}, "axes", "no such axis"),
    ("scale_expansion", {"axis": "X"}, "signals", "needs this key"),
    ("scale_expansion", {"axis": "X", "signals": []}, "signals", ""),
    ("scale_expansion", {"axis": "X", "signals": "T9"}, "signals", "no such signal"),
    ("scale_expansion", {"axis": "X", "signals": "T1", "tau": -5.0}, "tau", ""),
    ("scale_expansion", {"axis": "X", "signals": "T1", "tau": "fitt"}, "tau", ""),
    ("scal", {"axis": "X"}, "kind", "unknown kind"),
]


@pytest.mark.parametrize(("kind", "keys", "field", "message"), WRONG)
def test_wrong_keys_are_named(kind, keys, field, message):
    m = machine("w b Y X Z C t", C=Axis("C", (-3.0, 3.0)))
    m = Machine("m", m.structure, m.axes, SIGNALS)
    with pytest.raises(InputError) as caught:
        make_effect(kind, keys).check(m)
    assert caught.value.field.split(".")[0] == field
    assert message in str(caught.value)


def test_the_catalogue_holds_the_six_and_each_has_its_page():
    six = ["positioning", "scale", "straightness", "angular", "squareness", "scale_expansion"]
    assert set(six) <= set(effect_kinds())
    for kind in six:
        page = effect_class(kind).__doc__
        for part in ("Formula", "Parameters", "Typical causes", "Cure", "Source"):
            assert part in page, (kind, part)


def test_comma_separated_keys_as_a_command_line_gives_them():
    assert make_effect("squareness", {"axes": "Y,X"}) == Squareness(axes=("Y", "X"))
    expansion = make_effect("scale_expansion", {"axis": "X", "signals": "T1,T2"})
    assert expansion.signals == ("T1", "T2")
    assert expansion.spec == "scale_expansion axis=X signals=T1,T2"


def test_a_spec_makes_the_same_effect_again():
    effect = Positioning(axis="X", shape="table", positions=(0.0, 1.5))
    kind, *pairs = effect.spec.split()
    keys = dict(pair.split("=") for pair in pairs)
    keys["positions"] = [float(p) for p in keys["positions"].split(",")]
    assert make_effect(kind, keys) == effect


@pytest.mark.parametrize("kind", ["positioning", "scale", "straightness", "angular", "squareness"])
def test_candidates_fit_the_machine_and_what_moved(kind):
    m = machine("w X' b Y Z C t", C=Axis("C", (-3.0, 3.0)))
    coverage = Coverage(moving=frozenset("XYC"))
    found = list(effect_class(kind).candidates(m, coverage))
    count = {"positioning": 2, "scale": 2, "straightness": 4, "angular": 6, "squareness": 1}[kind]
    assert len(found) == len({e.spec for e in found}) == count
    for effect in found:
        effect.check(m)


def test_candidates_of_expansion_prefer_the_axis_s_own_sensors():
    coverage = Coverage(moving=frozenset("X"), signals=dict.fromkeys(SIGNALS, (19.0, 24.0)))
    found = list(ScaleExpansion.candidates(WARM, coverage))
    direct = [e.signals for e in found if e.tau is None]
    assert direct == [("T1", "T2"), ("T1",), ("T2",), ("T_amb",)]
    assert [e.signals for e in found if e.tau == "fit"] == direct


def test_parameters_have_units_and_plausible_ranges():
    for effect, unit in [
        (Positioning(axis="X"), "mm"),
        (Angular(axis="X", about="Z"), "rad"),
        (Scale(axis="X"), "1"),
        (ScaleExpansion(axis="X", signals=("T1",)), "1/K"),
        (Squareness(axes=("Y", "X")), "rad"),
    ]:
        for parameter in effect.linear(WARM):
            assert parameter.unit == unit
            assert parameter.plausible[0] < 0.0 < parameter.plausible[1]


def test_kinks_are_where_values_start_to_be_held():
    assert Scale(axis="X").kinks(BRIDGE) == {"X": (0.0, 700.0)}
    assert Positioning(axis="X", shape="constant").kinks(BRIDGE) == {}
    table = Positioning(axis="X", shape="table", positions=(0.0, 5.0))
    assert table.kinks(BRIDGE) == {"X": (0.0, 5.0)}
    assert ErrorMotion("X", "A").unit == "rad"
