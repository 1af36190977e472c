"""Formula effects: channels, units of coefficients, kinks, and errors that say what exists."""

from __future__ import annotations

import numpy as np
import pytest

from abbe.compcore.compensator.compensator import Compensator
from abbe.compcore.effects import Formula, make_effect
from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import FUNCTIONAL_POINT, ErrorMotion
from abbe.compcore.model.model import Model, Term, Value
from tests.support.compcore.catalogue import FIVE_AXIS, MILL


def formula(terms, channel="E_XX", machine=MILL) -> Formula:
    effect = make_effect("formula", {"channel": channel, "terms": terms})
    effect.check(machine)
    return effect


@pytest.mark.parametrize(
    ("text", "channel"),
    [
        ("dX", ErrorMotion(FUNCTIONAL_POINT, "X")),
        ("dZ", ErrorMotion(FUNCTIONAL_POINT, "Z")),
        ("E_XX", ErrorMotion("X", "X")),
        ("E_ZY", ErrorMotion("Y", "Z")),
        ("E_CZ", ErrorMotion("Z", "C")),
    ],
)
def test_channels(text, channel):
    assert formula("X", text).target() == channel


@pytest.mark.parametrize("text", ["X", "E_XQ", "E_DX", "dA", "E_XXX", "", "d", "E_X"])
def test_what_is_no_channel_is_refused(text):
    with pytest.raises(InputError, match="not an error motion"):
        formula("X", text)


def test_a_channel_of_an_axis_that_is_not_there():
    with pytest.raises(InputError, match="no such axis.*one of X, Y, Z"):
        formula("X", "E_BC")
    assert formula("X", "E_BC", FIVE_AXIS).target() == ErrorMotion("C", "B")


@pytest.mark.parametrize(
    ("channel", "term", "unit"),
    [
        ("E_XX", "X", "1"),
        ("E_XX", "X*(T_x - T0)", "1/K"),
        ("E_XX", "X**2", "1/mm"),
        ("E_CY", "X*Y", "rad/mm²"),
        ("E_CY", "T_front - T_rear", "rad/K"),
        ("E_CY", "Z*(T_front - T_rear)", "rad/(K·mm)"),
        ("dZ", "load", "mm/kg"),
        ("dZ", "speed*X_dir", "mm/rpm"),
        ("dZ", "feed", "min"),
        ("dZ", "t", "mm/s"),
        ("dZ", "sin(2*pi*X/10)", "mm"),
    ],
)
def test_units_of_the_coefficients(channel, term, unit):
    (parameter,) = formula(term, channel).linear(MILL)
    assert parameter.unit == unit


def test_plausible_is_what_moves_the_channel_by_a_plausible_amount():
    (parameter,) = formula("X").linear(MILL)
    # X goes to 800 mm: 0.2 mm of it
    assert parameter.plausible[1] == pytest.approx(0.2 / 800.0, rel=0.05)
    (parameter,) = formula("X*(T_x - T0)", "E_AX").linear(MILL)
    assert 5e-4 / 8000.0 < parameter.plausible[1] < 5e-4 / 4000.0


def test_terms_of_a_command_line_are_split_outside_parentheses():
    effect = formula("max(X, Y)*2, lag(T_x,  600) - T0 ,Z")
    assert effect.terms == ("max(X,Y)*2", "lag(T_x,600)-T0", "Z")
    assert effect.spec == "formula channel=E_XX terms=max(X,Y)*2,lag(T_x,600)-T0,Z"
    assert effect.signals_needed() == ("T_x",)
    assert effect.positions_used(MILL) == ("X", "Y", "Z")
    assert [p.name for p in effect.linear(MILL)] == ["c1", "c2", "c3"]


def test_spaces_within_a_signal_s_name_stay():
    assert make_effect("formula", {"channel": "dX", "terms": "signal('T b') - T0"}).terms == (
        "signal('T b')-T0",
    )


def test_directions():
    effect = formula("X_dir*Y, abs(Z_dir)")
    assert effect.directions_used() == ("X", "Z")
    assert effect.positions_used(MILL) == ("Y",)


@pytest.mark.parametrize(
    ("terms", "kinks"),
    [
        ("X", (0.0, 800.0)),
        ("abs(X - 350)", (0.0, 350.0, 800.0)),
        ("max(X, 200, X/2 + 300)", (0.0, 200.0, 600.0, 800.0)),
        ("min(sin(2*pi*X/800), 0.5)", (0.0, 800.0 / 12.0, 800.0 * 5.0 / 12.0, 800.0)),
        ("abs(X + 50)", (0.0, 800.0)),
        ("abs(max(X - 350.1, 0))", (0.0, 350.1, 800.0)),
        ("exp(-X/200)", (0.0, 800.0)),
        ("X*sign(Y_dir)", (0.0, 800.0)),
    ],
)
def test_kinks(terms, kinks):
    found = formula(terms).kinks(MILL)["X"]
    # max of three also lists the crossing that the third covers
    assert all(min(abs(k - f) for f in found) < 1e-9 for k in kinks)
    assert len(found) <= len(kinks) + 1


def test_a_jump_has_both_of_its_sides():
    found = formula("sign(X - 300.05)").kinks(MILL)["X"]
    around = [k for k in found if abs(k - 300.05) < 1e-6]
    assert len(around) >= 2
    assert min(around) < 300.05 <= max(around)


@pytest.mark.parametrize(
    ("terms", "moves"),
    [
        ("abs(X - 350)", False),
        ("X*abs(T_x - T0)", False),
        ("max(T_x - T0, 0)*Y", False),
        ("sign(X_dir)*Y", False),
        ("abs(X - 100*(T_x - T0))", True),
        ("max(X - 100*(T_x - T0), 0)*Y/500", True),
        ("sign(X - Y)", True),
        ("min(X, t/10)", True),
    ],
)
def test_kinks_that_move_are_known_and_followed_live(terms, moves):
    """Within 10 nm at any point, at temperatures that no table was made for."""
    effect = formula(terms, "E_ZX")
    assert effect.kinks_move(MILL) == moves
    model = Model(MILL, (Term(effect, {"c1": Value(1e-4)}),))
    live = Compensator(model)
    rng = np.random.default_rng(5)
    n = 2000
    for k in range(3):
        signals = {name: rng.uniform(21.0, 26.0) for name in model.signals_needed()}
        live.update(300.0 * k, signals)
        positions = np.stack([rng.uniform(*MILL.axes[a].travel, n) for a in live.axes], axis=1)
        at = Conditions(
            positions={a: positions[:, i] for i, a in enumerate(live.axes)},
            time=np.full(n, 300.0 * k),
            signals={name: np.full(n, v) for name, v in signals.items()},
        )
        truth = np.stack([model.axis_error(at)[a] for a in "XYZ"], axis=1)
        np.testing.assert_allclose(live.errors(positions), truth, atol=1e-5)


@pytest.mark.parametrize(
    ("terms", "said"),
    [
        ("X*Q", "unknown name"),
        ("C", "unknown name"),
        ("X + T_x", "cannot be added"),
        ("lag(Q, 5)", "lag needs the name of a signal"),
        ("signal('Q')", "signal needs the name of a signal"),
    ],
)
def test_errors_name_the_formula_and_what_exists(terms, said):
    with pytest.raises(InputError, match=said) as caught:
        formula(terms)
    assert caught.value.field == "terms"
    assert "T_x" in str(caught.value)


def test_errors_of_grammar_come_before_any_machine():
    with pytest.raises(InputError, match="not allowed here") as caught:
        make_effect("formula", {"channel": "dX", "terms": ["X if Y else Z"]})
    assert caught.value.field == "terms"


def test_no_terms():
    with pytest.raises(InputError, match="terms"):
        make_effect("formula", {"channel": "dX", "terms": []})


def test_a_term_without_a_value_says_where():
    at = Conditions.at({"X": [1.0, 100.0], "Y": 5.0, "Z": 0.0})
    with pytest.raises(InputError, match=r"no value at X = 100, Y = 5"):
        formula("1/(X - 100)").motions(MILL, at, {})
    with pytest.raises(InputError, match="no value"):
        formula("sqrt(X - 50)").motions(MILL, at, {})


def test_positions_are_held_at_the_ends_of_the_travel():
    at = Conditions.at({"X": [-10.0, 900.0], "Y": 0.0, "Z": 0.0})
    (motion,) = formula("X").motions(MILL, at, {})
    assert motion.columns[:, 0].tolist() == [0.0, 800.0]
