"""Change of the predicted error from one state of temperatures, load and tool to another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from abbe.compcore.compensator.folding.slow_state import SlowState
from abbe.compcore.model.model import Model
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.volume import Volume

_POINTS = 610


@dataclass(frozen=True)
class LargestChange:
    """The largest change of the predicted error over a volume, and where it is, mm.

    Attributes
    ----------
    largest
        Length of the change of the error vector where it is greatest, mm.
    where
        Axis → that position, mm or rad.
    """

    largest: float
    where: dict[str, float]


def predicted_change(
    model: Model, volume: Volume, before: SlowState, after: SlowState
) -> LargestChange:
    """The largest change of a model's error over a volume between two states."""
    where = volume.spread(model.machine.structure.axes, _POINTS)
    change = ErrorField(model, after)(where) - ErrorField(model, before)(where)
    length = np.linalg.norm(change, axis=1)
    worst = int(length.argmax())
    return LargestChange(float(length[worst]), {a: float(p[worst]) for a, p in where.items()})
