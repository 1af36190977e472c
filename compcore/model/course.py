"""How far an axis's error motion goes over what was measured of it."""

from __future__ import annotations

import numpy as np

from abbe.compcore.effects.catalogue.shaped import ShapedEffect
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Term

_POINTS = 201


def peak_to_valley(term: Term, machine: Machine, low: float, high: float) -> float | None:
    """Greatest less least of an error motion between two positions of its axis, mm or rad.

    None for an effect that is no error motion of one axis. A shape's coefficients say nothing one
    by one; this is what a metrologist reads from its curve (ISO 230-1, 3.4).
    """
    if not isinstance(term.effect, ShapedEffect):
        return None
    positions = {name: np.full(_POINTS, axis.middle) for name, axis in machine.axes.items()}
    positions[term.effect.axis] = np.linspace(low, high, _POINTS)
    conditions = Conditions(positions=positions)
    (motion,) = term.effect.motions(machine, conditions, term.nonlinear(machine))
    return float(np.ptp(motion.columns @ term.coefficients(machine)))
