"""How far an axis's error motion goes over what was measured of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects.catalogue.shaped import ShapedEffect
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Term

_POINTS = 201


def peak_to_valley(term: Term, machine: Machine, low: float, high: float) -> float | None:
    """Greatest less least of an error motion between two positions of its axis, mm or rad.

    None for an effect that is no error motion of one axis, or goes with a signal. A shape's
    coefficients say nothing one by one; this is what a metrologist reads from its curve (ISO 230-1,
    3.4).
    """
    if not isinstance(term.effect, ShapedEffect) or _depends(term.effect):
        return None
    return float(np.ptp(_along(term.effect, term, machine, low, high, 0.0)))


def play(term: Term, machine: Machine, low: float, high: float) -> tuple[float, float] | None:
    """Least and greatest reversal of an axis between two of its positions, mm or rad.

    Signed as backlash is: mean arrival in the positive direction less that in the negative one
    (the reversal value of ISO 230-2). None for an effect that does not depend on the approach.
    """
    effect = term.effect
    if not isinstance(effect, ShapedEffect) or not effect.directions_used():
        return None
    if effect.signals_needed() or effect.reads_time():
        return None
    up, down = (_along(effect, term, machine, low, high, sense) for sense in (1.0, -1.0))
    return float((up - down).min()), float((up - down).max())


def _depends(effect: ShapedEffect) -> bool:
    """Whether a curve is another by the approach, a signal or the clock."""
    return bool(effect.directions_used() or effect.signals_needed() or effect.reads_time())


def _along(
    effect: ShapedEffect, term: Term, machine: Machine, low: float, high: float, sense: float
) -> NDArray[np.float64]:
    """An error motion along its axis, approached in one direction, shape (points,)."""
    positions = {name: np.full(_POINTS, axis.middle) for name, axis in machine.axes.items()}
    positions[effect.axis] = np.linspace(low, high, _POINTS)
    directions = {name: np.full(_POINTS, sense) for name in effect.directions_used()}
    conditions = Conditions(positions=positions, directions=directions)
    (motion,) = effect.motions(machine, conditions, term.nonlinear(machine))
    return np.asarray(motion.columns @ term.coefficients(machine))
