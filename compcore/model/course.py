"""How far an axis's error motion goes over what was measured of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects.catalogue.shaped import ShapedEffect
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Term

_POINTS = 201
_TIMES = 4.0
"""Times half of what was read from which on a curve runs away."""
_LITTLE = 1e-3
_LITTLE_ANGLE = 2e-6
"""mm, rad: less than this is no matter."""


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


@dataclass(frozen=True, slots=True)
class RunAway:
    """A curve that says much more where its axis was not read than where it was.

    Attributes
    ----------
    effect
        Its spec.
    axis
        The axis, and where on it the curve is farthest from all that was read, mm or rad.
    place
        See `axis`.
    away
        How far it is there from the middle of what it says where it was read, mm or rad, signed.
    read
        Greatest less least of what it says where it was read, mm or rad.
    angle
        Whether both are rad.
    """

    effect: str
    axis: str
    place: float
    away: float
    read: float
    angle: bool


def runs_away(term: Term, machine: Machine, read: NDArray[np.float64]) -> RunAway | None:
    """Whether a curve leaves what was read of it, between targets or beyond; None: it does not.

    A spline or polynomial goes through all targets and may swing by many times as much where nobody
    read it; a table or a live correction would use that. A tenth of a micrometre is nothing.

    Parameters
    ----------
    term
        A fitted effect.
    machine
        Its machine.
    read
        Positions of its axis at which there are rows, mm or rad.
    """
    effect = term.effect
    if not isinstance(effect, ShapedEffect) or not term.fitted or not len(read):
        return None
    if _depends(effect) or effect.shape == "table":
        return None
    axis = machine.axis(effect.axis)
    low, high = axis.travel
    places = np.unique(np.clip(read, low, high))
    there = _curve(effect, term, machine, places)
    everywhere = np.linspace(low, high, _POINTS)
    away = _curve(effect, term, machine, everywhere) - 0.5 * (there.max() + there.min())
    size = float(np.ptp(there))
    k = int(np.argmax(np.abs(away)))
    angle = effect.component() in "ABC"
    least = _LITTLE_ANGLE if angle else _LITTLE
    if abs(away[k]) <= max(_TIMES * 0.5 * size, least):
        return None
    return RunAway(effect.spec, effect.axis, float(everywhere[k]), float(away[k]), size, angle)


def _depends(effect: ShapedEffect) -> bool:
    """Whether a curve is another by the approach, a signal or the clock."""
    return bool(effect.directions_used() or effect.signals_needed() or effect.reads_time())


def _along(
    effect: ShapedEffect, term: Term, machine: Machine, low: float, high: float, sense: float
) -> NDArray[np.float64]:
    """An error motion along its axis, approached in one direction, shape (points,)."""
    return _curve(effect, term, machine, np.linspace(low, high, _POINTS), sense)


def _curve(
    effect: ShapedEffect, term: Term, machine: Machine, at: NDArray[np.float64], sense: float = 0.0
) -> NDArray[np.float64]:
    """An error motion at positions of its axis, approached in one direction, the shape of `at`."""
    positions = {name: np.full(len(at), axis.middle) for name, axis in machine.axes.items()}
    positions[effect.axis] = at
    directions = {name: np.full(len(at), sense) for name in effect.directions_used()}
    conditions = Conditions(positions=positions, directions=directions)
    (motion,) = effect.motions(machine, conditions, term.nonlinear(machine))
    return np.asarray(motion.columns @ term.coefficients(machine))
