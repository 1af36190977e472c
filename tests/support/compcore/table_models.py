"""Machines with known errors, for tests of tables: rigid ones with 21 errors, and worse."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.effects import (
    Angular,
    Backlash,
    CrossAngular,
    Effect,
    Positioning,
    RotaryLocation,
    RotaryPositioning,
    RotaryRadial,
    RotaryTilt,
    ScaleExpansion,
    Squareness,
    Straightness,
    ThermalOffset,
)
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value

TRAVELS = {"X": (-100.0, 500.0), "Y": (0.0, 800.0), "Z": (-300.0, 50.0)}
SIGNALS = {n: Signal(n, "degC", "scale", a) for n, a in (("T_x", "X"), ("T_y", "Y"))}


def machine(code: str = "w b Y X Z t") -> Machine:
    structure = Structure.parse(code)
    axes = {
        a: Axis(a, TRAVELS[a])
        if a in TRAVELS
        else Axis(a, (-1.5, 1.2), location=(120.0, 250.0, -60.0))
        for a in structure.axes
    }
    return Machine("test", structure, axes, SIGNALS)


def values(effect: Effect, owner: Machine, rng: np.random.Generator, size: float) -> Term:
    """An effect with random parameters of a size, mm or rad."""
    return Term(effect, {p.name: Value(float(rng.normal(0.0, size))) for p in effect.linear(owner)})


def rigid(code: str = "w b Y X Z t", seed: int = 1, shape: str = "spline:6") -> Model:
    """Eighteen error motions and three squarenesses: tens of µm, tens of µrad."""
    rng = np.random.default_rng(seed)
    owner = machine(code)
    terms = []
    for axis in owner.structure.linear:
        keys = {"axis": axis, "shape": shape}
        if shape == "table":
            keys["positions"] = tuple(np.linspace(*TRAVELS[axis], 14))
        terms.append(values(Positioning(**keys), owner, rng, 0.012))
        for direction in "XYZ":
            if direction != axis:
                terms.append(values(Straightness(**keys, direction=direction), owner, rng, 0.006))
            terms.append(values(Angular(**keys, about=direction), owner, rng, 2e-5))
    terms += [
        values(Squareness(axes=pair), owner, rng, 4e-5)
        for pair in combinations(owner.structure.linear, 2)
    ]
    return Model(owner, tuple(terms))


def with_terms(model: Model, *terms: Term) -> Model:
    return Model(model.machine, (*model.terms, *terms), model.composition)


def with_backlash(model: Model, size: float = 0.010) -> Model:
    """Backlash of all linear axes, mm: arriving from below the carriage stops short."""
    terms = [
        Term(Backlash(axis=a), {"b": Value(-size * (1.0 + 0.3 * i))})
        for i, a in enumerate(model.machine.structure.linear)
    ]
    return with_terms(model, *terms)


def thermal(model: Model) -> Model:
    return with_terms(
        model,
        Term(ScaleExpansion(axis="X", signals=("T_x",)), {"alpha": Value(1.1e-5)}),
        Term(ThermalOffset(direction="Z", signal="T_y", tau=600.0), {"k": Value(2e-3)}),
    )


def not_rigid(model: Model) -> Model:
    """An angle of Y that grows with X besides."""
    effect = CrossAngular(axis="Y", about="X", by="X")
    names = [p.name for p in effect.linear(model.machine)]
    return with_terms(model, Term(effect, {n: Value(6e-8) for n in names}))


FIVE_AXES = "w C' Y' b X Z B t"
FOUR_AXES = "w C' Y' b X Z t"


def five_axes(seed: int = 3) -> Model:
    """Two rotary axes, one on each side, with errors of their own."""
    return turning(FIVE_AXES, seed)


def turning(code: str, seed: int = 3) -> Model:
    """A rotary table C and, where the structure has it, a head B, with errors of their own."""
    model = rigid(code, seed)
    rng = np.random.default_rng(seed + 100)
    owner = model.machine
    terms = []
    for axis in owner.structure.rotary:
        terms.append(values(RotaryPositioning(axis=axis, harmonics=2), owner, rng, 1e-5))
        terms.append(values(RotaryLocation(axis=axis), owner, rng, 1e-3))
        for direction in [d for d in "XYZ" if d != {"C": "Z", "B": "Y"}[axis]]:
            terms.append(
                values(RotaryRadial(axis=axis, direction=direction, harmonics=2), owner, rng, 2e-3)
            )
            terms.append(values(RotaryTilt(axis=axis, direction=direction), owner, rng, 1e-5))
    return with_terms(model, *terms)


def state(tool: tuple[float, float, float] = (0.0, 0.0, -120.0), **signals: float) -> SlowState:
    return SlowState(tool=tool, signals={"T_x": 20.0, "T_y": 20.0} | signals)


def random_rows(model: Model, count: int, seed: int = 7) -> dict[str, np.ndarray]:
    """Positions spread at random over the travels."""
    rng = np.random.default_rng(seed)
    return {n: rng.uniform(*a.travel, count) for n, a in model.machine.axes.items()}
