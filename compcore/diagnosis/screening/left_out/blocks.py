"""Blocks of a campaign that are left out to judge an effect: as narrow as what it says."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.left_out.crossvalidation import (
    LeftOut,
    clock_order,
    cut_alone,
    folds,
    lonely,
)
from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.catalogue.rotary.over_an_arc import RotaryMotion
from abbe.compcore.effects.shapes import CUBIC, Shape
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine

Rows = list[NDArray[np.int64]]

_WHOLE = 0.5
"""Part of what an axis moved in all that a pass has to see of it."""


def passes(conditions: Conditions, axis: str) -> Rows:
    """The rows of each pass along an axis, from where it turned to where it turns again.

    What one pass says of a place another has to say again, while all else that goes on in time is
    another. Empty where there were not two passes over half of the way.
    """
    order = np.argsort(clock_order(conditions), kind="stable")
    at = conditions.position(axis)[order]
    step = np.sign(np.diff(at, prepend=at[:1]))
    # where it stood, it goes on as before
    last = np.maximum.accumulate(np.where(step != 0.0, np.arange(len(step)), 0))
    turned = np.flatnonzero(np.diff(step[last])) + 1
    found = np.split(order, turned[turned > 1])
    least = _WHOLE * float(np.ptp(at))
    whole = [r for r in found if least > 0.0 and np.ptp(conditions.position(axis)[r]) >= least]
    if len(whole) < 2 or sum(map(len, whole)) < _WHOLE * conditions.n:
        return []
    return [np.sort(r) for r in whole]


@dataclass(frozen=True, eq=False)
class Blocks:
    """The blocks of a campaign, each to be left out in its turn.

    Attributes
    ----------
    conditions, machine
        The campaign's rows, and what was measured.
    """

    conditions: Conditions
    machine: Machine
    _found: dict[tuple[tuple[str, float], ...], Rows] = field(default_factory=dict, repr=False)
    _cut: dict[tuple[object, ...], Rows] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, conditions: Conditions, machine: Machine) -> Blocks:
        """The blocks of these rows, dealt once."""
        # what is kept holds the machine, so that its id stays its own
        return conditions.kept(("blocks", id(machine)), lambda: cls(conditions, machine))

    @property
    def usual(self) -> Rows:
        """Blocks for what is no shape over an axis."""
        return self.for_effects(())

    def for_effects(self, effects: Iterable[Effect]) -> Rows:
        """Blocks that can judge some effects; always the same lists for the same detail."""
        finest = self._finest(effects)
        key = tuple(sorted(finest.items()))
        if key not in self._found:
            self._found[key] = folds(self.conditions, detail=finest)
        return self._found[key]

    def cut_for(self, effects: Sequence[Effect], before: LeftOut, after: LeftOut) -> Rows:
        """The same blocks with those cut that alone show something of some effects.

        Empty where there are none, or an effect follows the clock or a signal: of that a stretch of
        an hour says nothing of another day.

        Parameters
        ----------
        effects
            What the two models differ by.
        before, after
            How the blocks are predicted by the one model and by the other.
        """
        alone = lonely(before, after) or lonely(after, before)
        if not alone or any(_follows(effect) for effect in effects):
            return []
        rows = list(before.folds)
        finest = self._finest(effects)
        key = (tuple(sorted(finest.items())), tuple(alone))
        if key not in self._cut:
            self._cut[key] = cut_alone(self.conditions, rows, alone, detail=finest)
        return self._cut[key]

    def _finest(self, effects: Iterable[Effect]) -> dict[str, float]:
        finest: dict[str, float] = {}
        for effect in effects:
            for axis, distance in self._detail(effect):
                finest[axis] = min(distance, finest.get(axis, distance))
        return finest

    def _detail(self, effect: Effect) -> Iterable[tuple[str, float]]:
        """An axis along which an effect is a shape, and the distance of its knots, mm or rad."""
        axis, shape = getattr(effect, "axis", None), getattr(effect, "shape", None)
        if not isinstance(axis, str) or axis not in self.conditions.positions:
            return
        low, high = self.machine.axis(axis).travel
        if shape is not None and shape.startswith("spline:") and shape[7:].isdigit():
            order = Shape.parse(shape).order
            yield axis, (high - low) / max(1, order - CUBIC)
        elif shape is None and isinstance(effect, RotaryMotion):
            yield axis, np.pi / effect.waves


def _follows(effect: Effect) -> bool:
    return effect.scope == "instrument" or bool(effect.signals_needed()) or effect.reads_time()
