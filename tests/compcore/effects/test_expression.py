"""Formulas: what can be written, what is refused and how it is said, what comes out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from abbe.compcore.effects.expressions.dimensions import Dimension
from abbe.compcore.effects.expressions.expression import parse_expression
from abbe.compcore.errors import InputError

VARIABLES = {
    "X": Dimension.of("mm"),
    "Y": Dimension.of("mm"),
    "C": Dimension.of("rad"),
    "X_dir": Dimension(),
    "t": Dimension.of("s"),
    "T0": Dimension.of("K"),
}
SIGNALS = {
    "T_a": Dimension.of("degC"),
    "T b": Dimension.of("degC"),
    "load": Dimension.of("kg"),
    "feed": Dimension.of("mm/min"),
}


KNOWN = {
    "X": 300.0,
    "Y": -20.0,
    "C": 0.5,
    "X_dir": -1.0,
    "t": 120.0,
    "T0": 20.0,
    "T_a": 23.5,
    "T b": 19.0,
    "load": 80.0,
    "feed": 1500.0,
}


class Fixed:
    def variable(self, name):
        return np.array([KNOWN[name]])

    def signal(self, name):
        return np.array([KNOWN[name]])

    def lagged(self, name, tau):
        return np.array([KNOWN[name] / tau])


def parse(text):
    return parse_expression(text, VARIABLES, SIGNALS)


@pytest.mark.parametrize(
    ("text", "value", "unit"),
    [
        ("X", 300.0, "mm"),
        ("X*(T_a - T0)", 300.0 * 3.5, "K·mm"),
        ("X - 350", -50.0, "mm"),
        ("-X + +Y", -320.0, "mm"),
        ("2*pi*X/10", 2 * math.pi * 30.0, "mm"),
        ("sin(2*pi*X/12)", math.sin(2 * math.pi * 25.0), "1"),
        ("cos(C)", math.cos(0.5), "1"),
        ("tan(C/2)", math.tan(0.25), "1"),
        ("exp(-t/600)", math.exp(-0.2), "1"),
        ("log(X/100)", math.log(3.0), "1"),
        ("sqrt(X*X)", 300.0, "mm"),
        ("sqrt(X)", math.sqrt(300.0), "mm^1/2"),
        ("abs(Y)", 20.0, "mm"),
        ("sign(Y)", -1.0, "1"),
        ("min(X, Y, 100)", -20.0, "mm"),
        ("max(X - 400, 0)", 0.0, "mm"),
        ("X**2", 9e4, "mm²"),
        ("X**-1*Y", -20.0 / 300.0, "1"),
        ("X**(1/2)*X**0.5", 300.0, "mm"),
        ("lag(T_a, 600) - T0", 23.5 / 600.0 - 20.0, "K"),
        ("lag('T b', 10*60)", 19.0 / 600.0, "K"),
        ("signal('T b') - T_a", -4.5, "K"),
        ("load*X*X_dir", -24000.0, "kg·mm"),
        ("feed*X_dir", -1500.0, "mm/min"),
        ("X/(T_a - T0)", 300.0 / 3.5, "mm/K"),
        ("7", 7.0, "1"),
        ("1.5e-3*t", 0.18, "s"),
    ],
)
def test_values_and_units(text, value, unit):
    node = parse(text)
    assert float(np.ravel(node.evaluate(Fixed()))[0]) == pytest.approx(value, rel=1e-14)
    assert str(node.dimension) == unit


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("X + T_a", "mm and K cannot be added"),
        ("min(X, t)", "mm and s cannot be added or compared"),
        ("X - X_dir", "mm and 1 cannot be added"),
        ("feed + X", "mm/min and mm cannot be added"),
        ("sin(X)", "sin of a quantity in mm"),
        ("sin(pi*X)", "sin of a quantity in mm"),
        ("exp(T_a - T0)", "exp of a quantity in K"),
        ("Q*X", "unknown name"),
        ("x", "unknown name"),
        ("foo(X)", "unknown function"),
        ("sin(X/10, 2)", "sin takes 1 argument(s), not 2"),
        ("min(X)", "min takes 2 argument(s), not 1"),
        ("sin()", "sin takes 1 argument(s), not 0"),
        ("sin(X/10, key=3)", "unknown function"),
        ("lag(X, 600)", "lag needs the name of a signal"),
        ("lag(T_a + T0, 600)", "lag needs the name of a signal"),
        ("lag(T_a, X)", "time constant"),
        ("lag(T_a, -5)", "time constant"),
        ("lag(T_a, 0)", "time constant"),
        ("signal('Q')", "signal needs the name of a signal"),
        ("X**Y", "exponent must be a number"),
        ("9**9**9", "exponent must be a number"),
        ("X**100", "exponent must be a number"),
        ("X // 2", "operator not allowed"),
        ("X % 2", "operator not allowed"),
        ("X @ Y", "operator not allowed"),
        ("X if Y else 1", "not allowed here"),
        ("X > 3", "not allowed here"),
        ("X and Y", "not allowed here"),
        ("not X", "not allowed here"),
        ("~X", "not allowed here"),
        ("[X]", "not allowed here"),
        ("{X}", "not allowed here"),
        ("X.real", "not allowed here"),
        ("X[0]", "not allowed here"),
        ("lambda: X", "not allowed here"),
        ("(y := 3)", "not allowed here"),
        ("f'{X}'", "not allowed here"),
        ("'text'", "not a number"),
        ("True", "not a number"),
        ("None", "not a number"),
        ("1j", "not a number"),
        ("1e999", "not a finite number"),
        ("__import__('os').system('true')", "unknown function"),
        ("(lambda: 1)()", "unknown function"),
        ("().__class__", "not allowed here"),
        ("X; Y", "cannot be read"),
        ("import os", "cannot be read"),
        ("X Y", "cannot be read"),
        ("", "cannot be read"),
        ("X +", "cannot be read"),
        ("(" * 300, "cannot be read"),
        ("-" * 100 + "X", "too deeply nested"),
        ("X+" * 400 + "X", "formula too long"),
        ("X\x00", "cannot be read"),
        ("1" * 450 + "*X", "not a finite number"),
    ],
)
def test_what_is_refused_says_why(text, said):
    with pytest.raises(InputError, match="formula") as caught:
        parse(text)
    assert said in str(caught.value)


def test_an_unknown_name_lists_what_exists():
    with pytest.raises(InputError) as caught:
        parse("X*Q")
    for name in (*VARIABLES, *SIGNALS, "sin", "lag", "pi"):
        assert name in str(caught.value)


def test_a_wrong_dimension_lists_what_exists_with_units():
    with pytest.raises(InputError) as caught:
        parse("X + T_a")
    for text in ("X [mm]", "T_a [K]", "t [s]", "load [kg]", "feed [mm/min]", "X_dir [1]"):
        assert text in str(caught.value)


@pytest.mark.parametrize(
    "unit", ["mm", "rad/(K·mm)", "mm/min", "rad/mm²", "1", "1/K", "%", "mm²/s"]
)
def test_units_are_written_as_they_are_read(unit):
    assert str(Dimension.of(unit)) == unit


def test_bases_of_units_do_not_depend_on_the_order():
    assert Dimension.of("K·mm") == Dimension.of("mm·K") == Dimension.of("mm*degC")


numbers = st.floats(-100.0, 100.0).map(lambda v: round(v, 3))
names = st.sampled_from([("X", 300.0), ("Y", -20.0), ("(X + Y)", 280.0), ("X_dir*X", -300.0)])


@st.composite
def formulas(draw, depth=0):
    """Text of a length in mm, and its value as Python's own arithmetic tells it."""
    if depth > 3:
        return draw(names)
    (a, x), (b, y) = draw(formulas(depth + 1)), draw(formulas(depth + 1))
    k = draw(numbers)
    choices = [
        (f"({a} + {b})", x + y),
        (f"({a} - {k})", x - k),
        (f"abs({a})", abs(x)),
        (f"min({a}, {b})", min(x, y)),
        (f"max({a}, {b}, {k})", max(x, y, k)),
        (f"(-{a})", -x),
        (f"{k}*{a}", k * x),
        (f"({a})*sin(({b})/97.0)", x * math.sin(y / 97.0)),
        (f"({a})*exp(-abs({b})/1e9)", x * math.exp(-abs(y) / 1e9)),
        draw(names),
    ]
    return draw(st.sampled_from(choices))


@given(formulas())
def test_it_computes_what_python_computes(pair):
    text, value = pair
    assume(len(text) <= 500)
    found = float(np.ravel(parse(text).evaluate(Fixed()))[0])
    assert found == pytest.approx(value, rel=1e-12, abs=1e-12)


@given(st.text(max_size=60))
def test_any_text_is_a_formula_or_an_error_of_its_own(text):
    try:
        node = parse(text)
    except InputError:
        return
    with np.errstate(all="ignore"):
        assert np.ravel(node.evaluate(Fixed())).shape == (1,)


alphabet = "XYTt0123456789.+-*/()_,' abcdeflgins"


@given(st.text(alphabet, max_size=40))
def test_text_that_looks_like_a_formula_too(text):
    try:
        node = parse(text)
    except InputError:
        return
    with np.errstate(all="ignore"):
        assert np.ravel(node.evaluate(Fixed())).shape == (1,)
