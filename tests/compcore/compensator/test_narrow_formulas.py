"""Formulas with something narrow in them: nothing hides between the nodes of a live table."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from abbe.compcore.compensator.compensator import Compensator
from abbe.compcore.effects import make_effect
from abbe.compcore.effects.catalogue.formula import Formula
from abbe.compcore.effects.expressions.bounds import bounds
from abbe.compcore.effects.expressions.interval import Interval
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value

TRAVELS = {"X": (0.0, 700.0), "Y": (0.0, 900.0), "Z": (-360.0, 0.0)}
OF = Machine(
    "test",
    Structure.parse("w b Y X Z t"),
    {a: Axis(a, t) for a, t in TRAVELS.items()},
    {"T_x": Signal("T_x", "degC", "scale", "X")},
)
LIMIT = 1.05e-5
"""10 nm, and rounding."""


def compensator(*terms: tuple[str, str, float]) -> Compensator:
    """A compensator of formulas: channel, text, coefficient."""
    effects = [make_effect("formula", {"channel": c, "terms": (text,)}) for c, text, _ in terms]
    values = [{"c1": Value(value)} for _, _, value in terms]
    return Compensator(Model(OF, tuple(map(Term, effects, values))))


def error(model: Model, conditions: Conditions) -> np.ndarray:
    """Errors along X, Y, Z, mm."""
    found = model.axis_error(conditions)
    return np.stack([found[a] for a in "XYZ"], axis=1)


def truth(model: Model, at: np.ndarray, warmth: float = 20.0) -> np.ndarray:
    """Error of the functional point by the effects themselves, mm."""
    rows = {a: at[:, i] for i, a in enumerate(OF.structure.axes)}
    signals = {"T_x": np.full(len(at), warmth)}
    return error(model, Conditions(positions=rows, signals=signals))


def along(axis: str, places: np.ndarray) -> np.ndarray:
    """Points with one axis at given places, the others somewhere, in the structure's order."""
    rng = np.random.default_rng(3)
    columns = {a: rng.uniform(*t, len(places)) for a, t in TRAVELS.items()}
    columns[axis] = places
    return np.stack([columns[a] for a in OF.structure.axes], axis=1)


def off(found: Compensator, at: np.ndarray, warmth: float = 20.0) -> float:
    """The largest deviation of the tables from the effects, mm."""
    return float(np.abs(found.errors(at) - truth(found.model, at, warmth)).max())


@settings(max_examples=60, deadline=None)
@given(
    axis=st.sampled_from("XYZ"),
    part=st.floats(0.0, 1.0),
    width=st.floats(-4.0, 1.5).map(lambda p: 10.0**p),
    shape=st.sampled_from(
        (
            "exp(-(({a} - {c})/{w})**2)",
            "1/(1 + (({a} - {c})/{w})**2)",
            "max(0, 1 - abs({a} - {c})/{w})",
            "sign({a} - {c}) - sign({a} - {c} - {w})",
            "(T_x - T0)/5*exp(-(({a} - {c})/{w})**2)",
            "sin({a}/40) + exp(-(({a} - {c})/{w})**2)",
        )
    ),
    height=st.sampled_from((1e-3, 1e-2, 0.1)),
)
def test_a_bump_of_any_width_at_any_place_is_followed(
    axis: str, part: float, width: float, shape: str, height: float
) -> None:
    low, high = TRAVELS[axis]
    centre = low + part * (high - low)
    text = shape.format(a=axis, c=f"({centre:.9f})", w=f"{width:.9f}")
    found = compensator(("dX", text, height))
    found.update(0.0, {"T_x": 23.0})
    near = centre + width * np.linspace(-6.0, 6.0, 1201)
    if "sign" in shape:  # within a jump, some micrometres wide, nothing is promised
        edges = np.array([centre, centre + width])
        near = near[np.abs(near[:, None] - edges).min(axis=1) > 3e-9 * (high - low)]
    rng = np.random.default_rng(1)
    places = np.clip(np.concatenate([near, rng.uniform(low, high, 400)]), low, high)
    assert off(found, along(axis, places), 23.0) <= LIMIT


@pytest.mark.parametrize(
    "text",
    [
        "exp(-((X - 123.456)/0.005)**2)*Y/900",
        "X_dir*exp(-((X - 123.456)/0.005)**2)",
        "exp(-((X - 123.456)/0.005)**2 - ((Y - 654.3)/0.005)**2)",
        "exp(-((X - Y + 530.844)/0.005)**2)",
        "Y/900*(1 + 0.01*exp(-((X - 123.456)/0.005)**2))",
    ],
)
def test_a_bump_over_several_axes_is_followed(text: str) -> None:
    found = compensator(("dZ", text, 0.01))
    at = along("X", 123.456 + np.linspace(-0.02, 0.02, 201))
    at[:, OF.structure.axes.index("Y")] = 654.3
    directions = np.ones_like(at)
    rows = {a: at[:, i] for i, a in enumerate(OF.structure.axes)}
    moved = dict.fromkeys(OF.structure.axes, np.ones(len(at)))
    expected = error(found.model, Conditions(positions=rows, directions=moved))
    assert np.abs(expected[:, 2]).max() > 1e-3
    assert np.abs(found.errors(at, directions) - expected).max() <= LIMIT


def test_a_bump_that_walks_with_a_temperature_is_followed() -> None:
    found = compensator(("dX", "exp(-((X - 350 - 3*T_x)/0.01)**2)", 0.01))
    for warmth in (18.0, 21.37, 95.0):
        found.update(0.0, {"T_x": warmth})
        near = 350.0 + 3.0 * warmth + np.linspace(-0.05, 0.05, 301)
        assert off(found, along("X", near), warmth) <= LIMIT


def test_what_is_smooth_stays_in_tables() -> None:
    found = compensator(
        ("dX", "((X - 350)/350)**4", 0.02),
        ("E_BX", "sin(2*pi*X/40)*(T_x - T0)", 1e-6),
        ("dY", "sqrt(abs(Y - 450))/20", 0.01),
        ("E_AY", "exp(-t/600)*cos(Y/100)", 1e-5),
        ("dZ", "X*Y*Z/1e8", 0.01),
    )
    assert found.direct_effects == ()


def test_a_formula_with_too_many_waves_for_a_table_is_followed() -> None:
    found = compensator(("dX", "sin(2*pi*X/0.01)", 0.01))
    assert len(found.direct_effects) == 1
    assert off(found, along("X", np.random.default_rng(0).uniform(0, 700, 2000))) <= LIMIT


class _Given:
    """A formula's names by hand."""

    def __init__(self, values: dict[str, np.ndarray]) -> None:
        self._values = values

    def variable(self, name: str) -> np.ndarray:
        return self._values[name]

    signal = variable

    def lagged(self, name: str, tau: float) -> np.ndarray:
        raise KeyError(name, tau)


LEAF = st.sampled_from(("X", "Y", "T_x/20", "3", "X/100", "(Y - 450)/300", "pi"))


def _grown(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    two = st.tuples(inner, inner)
    return st.one_of(
        st.tuples(st.sampled_from("+-*/"), two).map(lambda v: f"({v[1][0]} {v[0]} {v[1][1]})"),
        st.tuples(
            st.sampled_from(("sin", "cos", "exp", "abs", "sign", "tan", "sqrt", "log")), inner
        ).map(lambda v: f"{v[0]}(({v[1]})/(1 + 0*X))"),
        st.tuples(st.sampled_from(("min", "max")), two).map(
            lambda v: f"{v[0]}({v[1][0]}, {v[1][1]})"
        ),
        st.tuples(inner, st.sampled_from(("2", "3", "0.5", "-1"))).map(
            lambda v: f"({v[0]})**{v[1]}"
        ),
    )


@settings(max_examples=300, deadline=None)
@given(
    text=st.recursive(LEAF, _grown, max_leaves=6),
    corner=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0)),
    size=st.floats(-4.0, 0.0),
)
def test_bounds_hold_at_every_point_of_a_box(
    text: str, corner: tuple[float, float, float], size: float
) -> None:
    free = Machine("free", OF.structure, dict(OF.axes), {"T_x": Signal("T_x", "", "scale", "X")})
    try:
        effect = Formula(channel="dX", terms=(text,))
        effect.check(free)
    except Exception:  # noqa: BLE001 (units that do not fit, a formula too long)
        return
    ends = {"X": (0.0, 700.0), "Y": (0.0, 900.0), "signal T_x": (15.0, 30.0)}
    part = 10.0**size
    box = {}
    for (name, (low, high)), at in zip(ends.items(), corner, strict=True):
        a = low + at * (1.0 - part) * (high - low)
        box[name] = (a, a + part * (high - low))
    boxes = {k: Interval.of([a], [b]) for k, (a, b) in box.items()}
    names = frozenset(effect.positions_used(free))
    ((_, node),) = effect.expressions(free, np.ones(1))
    found = bounds(node, boxes, names)
    rng = np.random.default_rng(0)
    x, y, t = (rng.uniform(a, b, 200) for a, b in box.values())

    def value(x: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            return np.broadcast_to(node.evaluate(_Given({"X": x, "Y": y, "T_x": t})), (200,))

    here = value(x)
    seen = np.isfinite(here)
    slack = 1e-9 * (1.0 + np.abs(here[seen]))
    assert (here[seen] >= found.value.low - slack).all()
    assert (here[seen] <= found.value.high + slack).all()
    if not np.isfinite(found.value.width).all():
        return  # there may be a pole
    # a secant's slope is a slope somewhere between its ends
    other = rng.uniform(*box["X"], 200)
    there = value(other)
    rise = (there - here) / np.where(other == x, 1.0, other - x)
    slope, _ = found.along("X")
    # what is lost to rounding in a difference of two large numbers
    lost = 1e-9 + 1e-11 * (np.abs(here) + np.abs(there)) / np.maximum(np.abs(other - x), 1e-300)
    good = np.isfinite(rise) & (other != x)
    assert (rise[good] >= (slope.low - lost - 1e-6 * np.abs(rise))[good]).all()
    assert (rise[good] <= (slope.high + lost + 1e-6 * np.abs(rise))[good]).all()
