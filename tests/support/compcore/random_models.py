"""Random machines and models over the whole catalogue, from a seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from abbe.compcore.campaign.coverage import Coverage
from abbe.compcore.effects import effect_kinds
from abbe.compcore.effects.base import Effect
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.lag import first_order_lag
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Composition, Model, Term, Value

LINEAR_CODES = (
    "w b Y X Z t",
    "w b X Y Z t",
    "w b Z Y X t",
    "w X' b Y Z t",
    "w Y' X' b Z t",
    "w Z' b X Y t",
    "w X' Y' Z' b t",
    "w Y' b X Z (C) t",
    "w (C') b Z X t",
    "w Y' b X t",
    "w b Z t",
)
ROTARY_CODES = (
    "w X' b Y Z C B (C) t",
    "w C' A' X' Y' b Z t",
    "w C' Y' b X Z B t",
    "w C' b X Y Z A t",
    "w A' b X Y Z t",
    "w b C X Y Z t",
    "w X' b B Y Z t",
    "w C' b Z X t",
    "w b C Z t",
)
TILTED = ("w X' b B Y Z t",)
"""Where a rotary axis would, a quarter of a turn on, lay two linear axes along one another."""
SIGNALS = (
    Signal("T_x", "degC", "scale", "X"),
    Signal("T_y", "degC", "scale", "Y"),
    Signal("T_z", "degC", "screw", "Z"),
    Signal("T_low", "degC", "structure"),
    Signal("T_high", "degC", "structure"),
    Signal("T_work", "degC", "workpiece"),
    Signal("T_spindle", "degC", "spindle"),
    Signal("load", "kg", "load"),
    Signal("feed", "mm/min", "speed"),
    Signal("speed", "rpm", "speed"),
)


def random_machine(code: str, rng: np.random.Generator) -> Machine:
    """A machine of a structure with random travels, rotation points and average lines."""
    structure = Structure.parse(code)
    axes = {}
    for name in structure.axes:
        if name in structure.rotary:
            most = 0.3 if code in TILTED else 2.0
            low = -rng.uniform(0.1, most)
            place = tuple(rng.uniform(-300.0, 300.0, 3))
            travel = (low, low + rng.uniform(0.25, 2.0) * most)
            axes[name] = Axis(name, travel, location=place)
        else:
            low = rng.uniform(-800.0, 100.0)
            point = tuple(rng.uniform(-50.0, 50.0, 3)) if rng.random() < 0.5 else (0.0, 0.0, 0.0)
            travel = (low, low + rng.uniform(100.0, 1500.0))
            axes[name] = Axis(name, travel, rotation_point=point)
    signals = {s.name: s if s.axis in (None, *axes) else replace(s, axis=None) for s in SIGNALS}
    return Machine("random", structure, axes, signals)


def candidates(machine: Machine) -> list[Effect]:
    """Every effect of machine and workpiece that the catalogue proposes for a machine."""
    axes = frozenset(machine.structure.axes)
    coverage = Coverage(
        moving=axes,
        reversing=axes,
        signals=dict.fromkeys(machine.signals, (0.0, 1.0)),
        duration=7200.0,
        rotations=True,
        tool_varies=True,
    )
    found: list[Effect] = []
    for cls in effect_kinds().values():
        if cls.scope != "instrument":
            found += cls.candidates(machine, coverage)
    return found


def with_values(machine: Machine, effect: Effect, rng: np.random.Generator) -> Term:
    """An effect with random values, a few micrometres to tens of them at the functional point."""
    values = {}
    for parameter in effect.linear(machine):
        low, high = parameter.plausible
        value = rng.uniform(0.25 * low, 0.25 * high)
        values[parameter.name] = Value(float(value))
    for other in effect.nonlinear(machine):
        low, high = other.plausible if np.all(np.isfinite(other.plausible)) else other.bounds
        low, high = max(low, other.bounds[0]), min(high, other.bounds[1])
        values[other.name] = Value(float(rng.uniform(low, high)))
    return Term(effect, values)


def random_model(
    machine: Machine,
    rng: np.random.Generator,
    count: int,
    composition: Composition = "first-order",
) -> Model:
    """A model of some effects of the catalogue, with various shapes."""
    effects = candidates(machine)
    kinds = sorted({e.kind for e in effects})
    terms: dict[str, Term] = {}
    for _ in range(count):
        kind = kinds[rng.integers(len(kinds))]
        own = [e for e in effects if e.kind == kind]
        effect = own[rng.integers(len(own))]
        if "shape" in type(effect).model_fields:
            axis = machine.axis(effect.axis)  # type: ignore[attr-defined]
            scale = 180.0 / np.pi if axis.rotary else 1.0
            shape = ("constant", "polynomial:4", "spline:9", "table")[rng.integers(4)]
            low, high = axis.travel
            inner = np.sort(rng.uniform(low, high, rng.integers(0, 30)))
            nodes = np.unique([low, *inner, high]) * scale
            keys = {"shape": shape, "positions": tuple(nodes) if shape == "table" else ()}
            effect = type(effect)(**{**effect.where(), **keys})
        terms[f"{effect.kind} {effect.where()}"] = with_values(machine, effect, rng)
    return Model(machine, tuple(terms.values()), composition)


def random_signals(rng: np.random.Generator, n: int) -> dict[str, np.ndarray]:
    """n samples of every signal: slow walks, in their own units."""
    found = {}
    for signal in SIGNALS:
        if signal.unit == "degC":
            found[signal.name] = 20.0 + rng.normal(0.0, 4.0) + np.cumsum(rng.normal(0.0, 0.5, n))
        else:
            most = {"kg": 500.0, "mm/min": 5000.0, "rpm": 10000.0}[signal.unit]
            found[signal.name] = rng.uniform(0.0, most, n)
    return found


def truth_conditions(
    model: Model,
    positions: np.ndarray,
    directions: np.ndarray,
    tool: tuple[float, float, float],
    times: np.ndarray,
    signals: dict[str, np.ndarray],
    spindle_angle: float | None = None,
) -> Conditions:
    """Conditions at the last of some samples, its lags computed from the samples as recorded."""
    n = len(positions)
    axes = model.machine.structure.axes

    class Recorded(Conditions):
        def lag(self, name: str, tau: float) -> np.ndarray:
            return np.full(n, first_order_lag(times, signals[name], tau)[-1])

    return Recorded(
        positions={a: positions[:, i] for i, a in enumerate(axes)},
        directions={a: directions[:, i] for i, a in enumerate(axes)},
        tool=np.tile(np.asarray(tool), (n, 1)),
        time=np.full(n, times[-1]),
        signals={name: np.full(n, values[-1]) for name, values in signals.items()},
        spindle_angle=None if spindle_angle is None else np.full(n, spindle_angle),
    )
