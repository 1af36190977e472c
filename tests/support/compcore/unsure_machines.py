"""Small machines with covariances stated by hand, and parts on them, for the virtual CMM."""

from __future__ import annotations

import numpy as np

from abbe.compcore.effects import Effect
from abbe.compcore.machine.machine import Axis, Machine, Signal
from abbe.compcore.machine.structure import Structure
from abbe.compcore.model.model import Model, Term, Value
from abbe.compcore.virtual_cmm.features import PartCharacteristic, TouchedFeature
from abbe.compcore.virtual_cmm.part_program import PartProgram

MACHINE = Machine(
    "small",
    Structure.parse("w b Y X Z t"),
    {
        "X": Axis("X", (0.0, 700.0)),
        "Y": Axis("Y", (0.0, 900.0)),
        "Z": Axis("Z", (-400.0, 100.0)),
    },
    {"T": Signal("T", "degC", "scale")},
)


def unsure(*known: tuple[Effect, dict[str, tuple[float, float]]]) -> Model:
    """A model of effects with parameter → (value, sd), independent of each other."""
    terms, variances = [], []
    for effect, values in known:
        terms.append(Term(effect, {k: Value(v, sd) for k, (v, sd) in values.items()}))
        variances += [sd**2 for _, sd in values.values()]
    return Model(MACHINE, tuple(terms), covariance=np.diag(variances))


def point(name: str, at: tuple[float, float, float], normal: tuple[float, float, float]):
    """One touched point."""
    n = np.array([normal], dtype=np.float64)
    place = np.array([at], dtype=np.float64)
    return TouchedFeature(name, "point", place, n, "1", place[0], n[0])


def hole(name: str, centre: tuple[float, float, float], radius: float, count: int):
    """A hole along Z touched evenly all round."""
    angle = 2.0 * np.pi * np.arange(count) / count
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    middle = np.array(centre)
    up = np.array([0.0, 0.0, 1.0])
    return TouchedFeature(name, "circle", middle + radius * out, -out, "1", middle, up, radius)


def length(first, second, **more) -> PartProgram:
    """The distance of two points."""
    one = PartCharacteristic("L", "distance", (first.name, second.name))
    return PartProgram("length", (first, second), (one,), **more)
