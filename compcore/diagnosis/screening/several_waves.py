"""Several waves of one axis: a further one is none where its period is that of one it has."""

from __future__ import annotations

from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.catalogue.linear.periodic import Cyclic
from abbe.compcore.model.model import Model

_CYCLES = 2.0
"""Cycles over the travel by which two waves differ at least: of fewer they are one that grows."""


def waves_of(model: Model, effect: Effect) -> list[float]:
    """The periods, mm or rad, of the other waves of an axis whose wave an effect is to be found."""
    if not isinstance(effect, Cyclic) or effect.period is not None:
        return []
    known: list[float] = []
    for t in model.terms:
        other = t.effect
        if not isinstance(other, Cyclic) or other.axis != effect.axis or other == effect:
            continue
        if other.period is not None or "period" in t.values:
            known += other.repeats(model.machine, t.nonlinear(model.machine)).values()
    return known


def one_wave(effect: Effect, model: Model, one: float, other: float) -> bool:
    """Whether two periods, mm or rad, of an effect's axis are too near each other for two waves."""
    travel = 2.0 * model.machine.axis(effect.where()["axis"]).half_travel
    return abs(1.0 / one - 1.0 / other) * travel < _CYCLES
