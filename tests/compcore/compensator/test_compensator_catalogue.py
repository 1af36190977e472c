"""Folding costs at most 10 nm: every kind of effect, random machines, random tools and signals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from abbe.compcore.compensator.compensator import Compensator
from abbe.compcore.effects import effect_kinds, make_effect
from abbe.compcore.model.model import Model, Term, Value
from tests.support.compcore.random_models import (
    LINEAR_CODES,
    ROTARY_CODES,
    candidates,
    random_machine,
    random_model,
    random_signals,
    truth_conditions,
    with_values,
)

TOLERANCE_NM = 10.0
seeds = st.integers(0, 2**32 - 1)


def sample(compensator: Compensator, rng: np.random.Generator, count: int) -> np.ndarray:
    """Points in the volume, at nodes, at ends of travels, and a little outside them."""
    machine = compensator.model.machine
    columns = []
    for name in compensator.axes:
        low, high = machine.axis(name).travel
        length = high - low
        nodes = compensator.nodes.get(name, np.array([low, high]))
        choices = np.stack(
            [
                rng.uniform(low, high, count),
                rng.choice(nodes, count),
                rng.choice([low, high], count),
                rng.uniform(low - 0.05 * length, high + 0.05 * length, count),
            ]
        )
        columns.append(choices[rng.choice(4, count, p=[0.7, 0.1, 0.1, 0.1]), np.arange(count)])
    return np.stack(columns, axis=1)


def check(model: Model, rng: np.random.Generator, *, count: int = 400) -> Compensator:
    """A compensator against the effects themselves, along a random history of signals."""
    spindle = model.machine.structure.spindle
    angle = float(rng.uniform(-3.0, 3.0)) if spindle else None
    tool = tuple(rng.uniform(-200.0, 200.0, 3).tolist())
    compensator = Compensator(model, tool=tool)
    compensator.set_tool(*tool, spindle_angle=angle)
    updates = int(rng.integers(1, 6))
    times = np.cumsum(rng.uniform(1.0, 900.0, updates))
    signals = random_signals(rng, updates)
    for i, time in enumerate(times):
        compensator.update(float(time), {name: float(v[i]) for name, v in signals.items()})
    at = sample(compensator, rng, count)
    directions = rng.integers(-1, 2, at.shape).astype(np.float64)
    conditions = truth_conditions(model, at, directions, tool, times, signals, angle)
    error = model.axis_error(conditions)
    expected = np.stack([error[a] for a in "XYZ"], axis=1)
    batch = compensator.errors(at, directions)
    off = np.linalg.norm(batch - expected, axis=1) * 1e6
    assert off.max() <= TOLERANCE_NM, f"{off.max():.2f} nm off at {at[off.argmax()]}"
    pairs = zip(at[:100].tolist(), directions[:100].tolist(), strict=True)
    steps = np.array([compensator.step(p, d) for p, d in pairs])
    assert np.abs(steps - batch[:100]).max() < 1e-9
    return compensator


@settings(max_examples=25, deadline=None)
@given(code=st.sampled_from(LINEAR_CODES), seed=seeds)
def test_random_models_on_linear_machines(code: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = random_model(random_machine(code, rng), rng, int(rng.integers(1, 10)))
    assert not check(model, rng).direct_effects


@settings(max_examples=10, deadline=None)
@given(code=st.sampled_from(LINEAR_CODES), seed=seeds)
def test_random_models_composed_exactly(code: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = random_model(random_machine(code, rng), rng, int(rng.integers(1, 6)), "exact")
    assert not check(model, rng).direct_effects


@settings(max_examples=10, deadline=None)
@given(code=st.sampled_from(ROTARY_CODES), seed=seeds, exact=st.booleans())
def test_random_models_on_machines_with_rotary_axes(code: str, seed: int, exact: bool) -> None:
    rng = np.random.default_rng(seed)
    composition = "exact" if exact else "first-order"
    model = random_model(random_machine(code, rng), rng, int(rng.integers(1, 6)), composition)
    assert not check(model, rng).direct_effects


# proposed for no machine: a grid that others measured (test_error_grid folds it), and two drives,
# of which a person must say where they are (test_two_drives folds them)
KINDS = [
    kind
    for kind, cls in effect_kinds().items()
    if cls.scope != "instrument" and kind not in ("error_grid", "two_drives")
]


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_effect(kind: str) -> None:
    """At full plausible size, whatever instances it proposes for a five-axis machine."""
    rng = np.random.default_rng(KINDS.index(kind))
    machine = random_machine("w C' Y' b X Z B (C) t", rng)
    own = [effect for effect in candidates(machine) if effect.kind == kind]
    if kind == "formula":
        own = [make_effect("formula", {"channel": "E_AX", "terms": ("X*T_x", "Z**2", "t*Y_dir")})]
    assert own
    for i in rng.choice(len(own), min(3, len(own)), replace=False):
        model = Model(machine, (with_values(machine, own[i], rng),))
        assert not check(model, rng, count=200).direct_effects


FORMULAS = [
    ("dX", "X*Y"),
    ("E_AX", "X*Y*Z"),
    ("dZ", "sin(2*pi*X/300)*cos(2*pi*Y/200)"),
    ("E_YX", "sin(X*Y/20000)"),
    ("dY", "sqrt(X**2+Y**2+Z**2+1)"),
    ("E_XX", "X_dir*Y"),
    ("E_CX", "X_dir*Y_dir*Z"),
    ("dX", "sign(X-X*Y_dir/2)"),
    ("dX", "sign(X+250)*T_x"),
    ("E_BY", "abs(Y+200)"),
    ("dZ", "exp(-(X-50)**2/200)*lag(T_x,600)"),
    ("E_XX", "sin(2*pi*X/40)"),
    ("dX", "(T_low-T_high)*X*Y*t"),
    ("dY", "min(X,200)*speed"),
    ("dX", "load*X**2*Z"),
    ("dZ", "t*X"),
    ("dX", "(T_x-T0)*(T_y-T0)*sin(X/50)"),
    ("dY", "max(X,Y)"),
    ("dX", "1/(1+exp((X+Y)/300))"),
]


@pytest.mark.parametrize(("channel", "text"), FORMULAS)
@pytest.mark.parametrize("code", ["w b Y X Z t", "w X' b Y Z C B (C) t"])
def test_formulas_that_do_not_separate(channel: str, text: str, code: str) -> None:
    rng = np.random.default_rng(FORMULAS.index((channel, text)))
    machine = random_machine(code, rng)
    effect = make_effect("formula", {"channel": channel, "terms": (text,)})
    size = effect.linear(machine)[0].plausible[1]
    model = Model(machine, (Term(effect, {"c1": Value(0.1 * size)}),))
    check(model, rng, count=3000)


@pytest.mark.parametrize("period", [0.02, 0.5, 5.0, 512.0 / 700.0, 123.4])
@pytest.mark.parametrize("travel", [(0.0, 512.0), (-317.3, 402.9)])
def test_periodic_errors_of_any_period(period: float, travel: tuple[float, float]) -> None:
    """A grating's period needs a million nodes along the axis, and few over one period."""
    rng = np.random.default_rng(7)
    machine = random_machine("w b Y X Z t", rng)
    axis = type(machine.axis("X"))("X", travel)
    machine = type(machine)("m", machine.structure, {**machine.axes, "X": axis}, machine.signals)
    effect = make_effect("cyclic", {"axis": "X", "period": period, "harmonics": 3})
    compensator = check(Model(machine, (with_values(machine, effect, rng),)), rng, count=2000)
    assert not compensator.direct_effects
    assert sum(len(nodes) for nodes in compensator.nodes.values()) < 20_000


def test_a_narrow_defect_is_not_missed() -> None:
    rng = np.random.default_rng(9)
    machine = random_machine("w b Y X Z t", rng)
    low, high = machine.axis("Y").travel
    keys = {"error": "E_ZY", "centre": low + 0.3717 * (high - low), "width": 0.05}
    model = Model(machine, (Term(make_effect("local_defect", keys), {"depth": Value(0.02)}),))
    compensator = check(model, rng)
    middle = [machine.axis(a).middle for a in compensator.axes]
    middle[compensator.axes.index("Y")] = keys["centre"]
    assert compensator.step(middle)[2] == pytest.approx(0.02, abs=1e-5)
