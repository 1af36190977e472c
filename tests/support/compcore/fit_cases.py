"""Small machines, models and campaigns for the tests of the fit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from abbe.compcore.campaign.campaign import Campaign, Kind, Tool
from abbe.compcore.effects import make_effect
from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Value
from benchmarks.sources.campaigns import Rows

TRAVELS = {"X": (0.0, 700.0), "Y": (0.0, 900.0), "Z": (-360.0, 0.0)}
DIRECTIONS = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


def bridge(*signals: str) -> Machine:
    axes = {name: Axis(name, travel) for name, travel in TRAVELS.items()}
    known = {name: Signal(name, "degC", "scale", "X") for name in signals}
    return Machine("bridge", Structure.parse("w b Y X Z t"), axes, known)


def mill() -> Machine:
    axes = {name: Axis(name, (0.0, 500.0)) for name in "XYZ"}
    return Machine("mill", Structure.parse("w Z' b X Y (C) t"), axes)


def model(machine: Machine, *specs: str) -> Model:
    """A model of effects given as one types them."""
    effects = []
    for spec in specs:
        kind, *keys = spec.split()
        effects.append(make_effect(kind, dict(key.split("=", 1) for key in keys)))
    return Model(machine).with_effects(*effects)


GEOMETRY = (
    "positioning axis=X shape=polynomial:3",
    "positioning axis=Y shape=polynomial:3",
    "straightness axis=X direction=Y shape=polynomial:3",
    "angular axis=X about=Z shape=polynomial:2",
    "angular axis=Y about=Z shape=polynomial:2",
    "squareness axes=Y,X",
)


def plane_rows(rows: Rows, sd: float = 0.5e-3, rotation_sd: float = 0.5e-6) -> None:
    """Lines along X and Y at several places, diagonals, yaw; values are zero."""
    x, y = np.linspace(0.0, 700.0, 15), np.linspace(0.0, 900.0, 15)
    zero = np.zeros(15)
    for k, at in enumerate((0.0, 450.0, 900.0)):
        place = {"X": x, "Y": at, "Z": -180.0}
        rows.add(f"x{k}", Kind.DISPLACEMENT, place, zero, sd, u=DIRECTIONS["X"])
        free = ("zero", "slope")
        rows.add(f"s{k}", Kind.DISPLACEMENT, place, zero, sd, u=DIRECTIONS["Y"], free=free)
    for k, at in enumerate((0.0, 350.0, 700.0)):
        place = {"X": at, "Y": y, "Z": -180.0}
        rows.add(f"y{k}", Kind.DISPLACEMENT, place, zero, sd, u=DIRECTIONS["Y"])
    for k, way in enumerate((x, x[::-1])):
        u = np.array([np.ptp(x) * (1 - 2 * k), np.ptp(y), 0.0])
        place = {"X": way, "Y": y, "Z": -180.0}
        rows.add(f"d{k}", Kind.DISPLACEMENT, place, zero, sd, u=tuple(u / np.linalg.norm(u)))
    for axis, way, other in (("X", x, "Y"), ("Y", y, "X")):
        place = {axis: way, other: 400.0, "Z": -180.0}
        rows.add(f"r{axis}", Kind.ROTATION, place, zero, rotation_sd, u=DIRECTIONS["Z"])


def distance_rows(rows: Rows, rng: np.random.Generator, sd: float = 0.5e-3) -> None:
    for base in ("B1", "B2", "B3"):
        for tool in ("T1", "T2"):
            for turn in (0.0, 2.0, 4.0):
                place = {axis: rng.uniform(0.0, 500.0, 20) for axis in "XYZ"}
                keys = {"tool_name": tool, "base": base, "spindle": turn + 0.1}
                rows.add("distances", Kind.DISTANCE, place, np.zeros(20), sd, free=(), **keys)
    rows.add("bases", Kind.BASE_DISTANCE, {}, np.zeros(2), sd, free=(), base="B1", base2="B2")


BASES = {
    "B1": (-50.0, -40.0, -250.0),
    "B2": (550.0, -60.0, -260.0),
    "B3": (240.0, 560.0, -240.0),
}
TOOLS = {
    "T1": Tool("T1", (0.0, 0.0, -60.0), ("x", "y", "z")),
    "T2": Tool("T2", (0.1, -0.1, -240.0), ("x", "z")),
}


def with_truth(
    model_: Model, campaign: Campaign, theta: np.ndarray, rng: np.random.Generator | None = None
) -> Campaign:
    """The campaign as measured on a machine that is exactly as the model says, with noise."""
    from dataclasses import replace

    problem = Problem(model_, campaign)
    value = problem.predicted(theta)
    if rng is not None:
        value = value + rng.normal(size=campaign.n) * campaign.sd
    return replace(campaign, value=value)


def random_theta(model_: Model, campaign: Campaign, rng: np.random.Generator, part: float = 0.05):
    """Values well inside the plausible ranges, base points and tools near what is stated."""
    layout = Problem(model_, campaign).layout
    theta = layout.start(campaign) + part * rng.normal(size=layout.size) * layout.scale
    for i, parameter in layout.searched.items():
        low = max(parameter.plausible[0], parameter.bounds[0])
        high = min(parameter.plausible[1], parameter.bounds[1])
        theta[i] = low + (high - low) * rng.uniform(0.2, 0.8)
    return theta


def fitted(model_: Model, values: Mapping[str, float]) -> Model:
    """A model with the given value for each parameter name of each one-parameter effect."""
    terms = []
    for term in model_.terms:
        names = [p.name for p in term.effect.linear(model_.machine)]
        terms.append({name: Value(values[term.effect.spec]) for name in names})
    return model_.with_values(terms)


def somewhere(rng: np.random.Generator, n: int = 40, **signals: float) -> Conditions:
    positions = {a: rng.uniform(*TRAVELS[a], n) for a in TRAVELS}
    return Conditions(positions, signals={k: np.full(n, v) for k, v in signals.items()})
