from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from abbe.compcore.effects import (
    Angular,
    Effect,
    Motion,
    Parameter,
    Positioning,
    Scale,
    ScaleExpansion,
    Squareness,
    Straightness,
)
from abbe.compcore.effects.base import INSTRUMENT, ErrorMotion
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain, first_order
from abbe.compcore.machine.machine import Machine, Signal
from abbe.compcore.model.model import Model, Term, Value
from tests.support.compcore.machines import machine

BRIDGE = machine()
WARM = Machine("m", BRIDGE.structure, BRIDGE.axes, {"T": Signal("T")})


class Offset(Effect):
    """An effect of the instrument, as a plugin might bring one."""

    kind = "test_offset"
    scope = "instrument"

    def linear(self, machine):
        return (Parameter("a", "mm", (-1.0, 1.0)),)

    def motions(self, machine, conditions, nonlinear):
        return (Motion(ErrorMotion(INSTRUMENT, "X"), np.ones((conditions.n, 1))),)


def fitted(effect, rng, size=1e-5):
    names = [p.name for p in (*effect.linear(WARM), *effect.nonlinear(WARM))]
    return Term(effect, {name: Value(float(rng.normal(0, size))) for name in names})


def rich_model(composition="first-order"):
    rng = np.random.default_rng(3)
    effects = [
        Positioning(axis="X"),
        Straightness(axis="Y", direction="Z", shape="polynomial:3"),
        Angular(axis="Y", about="Z"),
        Angular(axis="X", about="Y"),
        Squareness(axes=("Y", "X")),
        ScaleExpansion(axis="Z", signals=("T",)),
    ]
    return Model(WARM, tuple(fitted(e, rng) for e in effects), composition)


def somewhere(n=20):
    rng = np.random.default_rng(4)
    return Conditions.at(
        {"X": rng.uniform(0, 700, n), "Y": rng.uniform(0, 900, n), "Z": rng.uniform(-360, 0, n)},
        tool=rng.uniform(-100, 100, (n, 3)),
        signals={"T": rng.uniform(19, 25, n)},
    )


def test_contributions_sum_to_the_whole():
    model, c = rich_model(), somewhere()
    parts = model.contributions(c)
    assert list(parts) == [e.spec for e in model.effects]
    assert all(np.abs(p).max() > 1e-6 for p in parts.values())
    np.testing.assert_allclose(sum(parts.values()), model.predict(c).translation, atol=1e-15)


def test_effects_of_one_error_motion_add_up():
    k, shift = Scale(axis="X"), Positioning(axis="X", shape="constant")
    model = Model(BRIDGE, (Term(k, {"k": Value(1e-5)}), Term(shift, {"value": Value(2e-3)})))
    c = Conditions.at({"X": [0.0, 100.0], "Y": 0.0, "Z": 0.0})
    np.testing.assert_allclose(model.error_motions(c)[ErrorMotion("X", "X")], [2e-3, 3e-3])


def test_an_unfitted_effect_predicts_nothing_and_needs_no_signal():
    model = Model(WARM, (Term(ScaleExpansion(axis="X", signals=("T",))),))
    c = Conditions.at({"X": 100.0, "Y": 0.0, "Z": 0.0})
    assert not model.terms[0].fitted
    assert model.signals_needed() == ()
    assert model.predict(c).translation.tolist() == [[0.0, 0.0, 0.0]]
    assert model.contributions(c) == {}
    assert rich_model().signals_needed() == ("T",)


def test_effects_of_the_instrument_are_never_compensated():
    model = Model(BRIDGE, (Term(Offset(), {"a": Value(0.5)}),))
    c = Conditions.at({"X": 100.0, "Y": 0.0, "Z": 0.0})
    for composition in ("first-order", "exact"):
        prediction = replace(model, composition=composition).predict(c)
        assert not prediction.translation.any()
    assert model.contributions(c) == {}


def test_orientation_of_both_compositions():
    c = somewhere()
    exact, small = rich_model("exact").predict(c), rich_model().predict(c)
    np.testing.assert_allclose(exact.orientation, small.orientation, atol=1e-8)
    np.testing.assert_allclose(exact.rotation, small.rotation, atol=1e-8)
    np.testing.assert_allclose(exact.translation, small.translation, atol=1e-5)
    w = small.rotation[0]
    for v in np.eye(3):
        np.testing.assert_allclose(small.orientation[0] @ v, v + np.cross(w, v), atol=1e-18)


def test_axis_error_is_the_components_on_a_machine_with_linear_axes():
    model, c = rich_model(), somewhere()
    along = model.axis_error(c)
    got = np.stack([along[a] for a in "XYZ"], axis=1)
    np.testing.assert_allclose(got, model.predict(c).translation, atol=1e-18)


def test_predict_is_the_lever_rule_on_the_error_motions():
    model, c = rich_model(), somewhere()
    expected, _ = first_order(Chain(model.machine, c), model.error_motions(c))
    np.testing.assert_array_equal(model.predict(c).translation, expected)


def test_the_same_effect_twice_is_refused():
    twice = (Term(Scale(axis="X")), Term(Scale(axis="X")))
    with pytest.raises(InputError, match=r"effects\[1\].*the same effect twice.*scale axis=X"):
        Model(BRIDGE, twice)


def test_values_must_be_all_or_none_and_known():
    effect = Positioning(axis="X", shape="polynomial:1")
    with pytest.raises(InputError, match=r"effects\[0\]\.parameters\.c1.*missing"):
        Model(BRIDGE, (Term(effect, {"c0": Value(0.0)}),))
    with pytest.raises(InputError, match=r"no such parameter: found 'c2', expected one of c0, c1"):
        Model(BRIDGE, (Term(effect, {n: Value(0.0) for n in ("c0", "c1", "c2")}),))


def test_an_effect_that_the_machine_cannot_have_is_named():
    with pytest.raises(
        InputError, match=r"effects\[0\]\.axis.*scale: the machine has no such axis"
    ):
        Model(BRIDGE, (Term(Scale(axis="W")),))


def test_with_effects_and_with_values():
    model = Model(BRIDGE).with_effects(Scale(axis="X"), Scale(axis="Y"))
    assert model.effects == (Scale(axis="X"), Scale(axis="Y"))
    filled = model.with_values([{"k": Value(1e-5, 1e-6)}, {}])
    assert [t.fitted for t in filled.terms] == [True, False]
    with pytest.raises(ValueError, match="shorter"):
        model.with_values([{}])


def test_models_compare_with_their_covariance():
    a = replace(rich_model(), covariance=np.eye(3))
    assert a == replace(rich_model(), covariance=np.eye(3))
    assert a != replace(rich_model(), covariance=2.0 * np.eye(3))
    assert a != rich_model()
    assert a != rich_model("exact")
    assert a != 5
