"""How a machine's errors usually run: a scale is off as a square is, in long waves more than short.

A curve of splines has many unknowns and a squareness one. Were each expected by itself, as far from
0 as it is believable, a scale that is off by 20 µm/m would be a rare thing, as all its splines have
to agree upon it, and an angle of 20 µrad a common one: of two diagonals, which cannot tell them
apart, all would be called squareness. So positioning has a slope besides, expected with the
squarenesses, and neighbouring splines go together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects import Positioning, RotaryLocation, RotaryPositioning, Squareness
from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.catalogue.shaped import ShapedEffect
from abbe.compcore.fitting.design.unknowns import UnknownLayout
from abbe.compcore.model.model import Model

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

USUAL = 0.02
"""Part of what is believable at most that a machine's errors usually are."""
_SCALE = 1e-3
"""Believable slope of positioning, mm/mm: as of the effect `scale`."""
_TOGETHER = 0.15
"""Part of the travel over which a curve's coefficients go together (Matérn, ν = 3/2)."""
_ALONE = 0.2
"""Part of their variance in which they do not."""
_TABLE = 4.0
"""By how much a rotary table's own angle is usually further off than its other motions."""
_FINE = 8
"""Places for each coefficient, to find which of them make a straight line."""


@dataclass(frozen=True, eq=False)
class UsualErrors:
    """Independent parts that a machine's errors are usually made of.

    Attributes
    ----------
    parts
        Shape (m, k): what each part does to the unknowns, in the unknowns' scales.
    kinds
        Kind of effect → its parts, which are expected alike; of effects of positions alone.
    usual
        Shape (k,): how large each part usually is, in scales; 1 where only what is believable is
        known, infinite where nothing is.
    """

    parts: F64
    kinds: Mapping[str, Index]
    usual: F64

    @classmethod
    def of(cls, model: Model, layout: UnknownLayout) -> UsualErrors:
        """Those of a model's unknowns."""
        m = layout.size
        parts = np.eye(m)
        slopes: list[F64] = []
        kinds: dict[str, list[int]] = {}
        usual = np.full(m, np.inf)
        for i, effect in enumerate(model.effects):
            where = layout.linear_of(i)
            usual[where] = 1.0
            if not _near_zero(effect) or where.stop == where.start:
                continue
            kinds.setdefault(effect.kind, []).extend(range(where.start, where.stop))
            if isinstance(effect, RotaryPositioning):
                parts[where, where] *= _TABLE
            line = _straight(effect, model)
            if line is None:
                continue
            axis = model.machine.axis(effect.axis)  # type: ignore[attr-defined]
            parts[where, where] = _long_waves(line / (2.0 * axis.half_travel))
            if isinstance(effect, Positioning):
                slope = np.zeros(m)
                slope[where] = _SCALE * (line - axis.middle) / layout.scale[where]
                kinds.setdefault(Squareness.kind, []).append(m + len(slopes))
                slopes.append(slope)
        at = {kind: np.array(found, dtype=np.int64) for kind, found in kinds.items()}
        usual = np.concatenate([usual, np.ones(len(slopes))])
        for own in at.values():
            usual[own] = USUAL
        return cls(np.column_stack([parts, *slopes]), at, usual)

    def covariance(self, size: F64) -> F64:
        """Of the unknowns, (m, m), in their scales, with the parts' sizes (k,)."""
        return np.asarray((self.parts * size**2) @ self.parts.T)


def _near_zero(effect: Effect) -> bool:
    if isinstance(effect, RotaryLocation):
        return False  # where a table stands is entered, not made: it is the first to be asked
    by_place = not (effect.signals_needed() or effect.reads_time() or effect.reads_model)
    return effect.scope == "machine" and by_place


def _straight(effect: Effect, model: Model) -> F64 | None:
    """Coefficients with which a curve is its axis's position, mm or rad; None: it has none."""
    if not isinstance(effect, ShapedEffect):
        return None
    axis, shape = model.machine.axis(effect.axis), effect.parsed_shape(model.machine)
    if shape.family not in ("spline", "table") or shape.size < 3:
        return None
    place = np.linspace(*axis.travel, _FINE * shape.size)
    found = np.linalg.lstsq(shape.basis(place, axis), place, rcond=None)[0]
    return np.asarray(found)


def _long_waves(place: F64) -> F64:
    """How coefficients at places along the travel (0 … 1) go together: a root of correlations."""
    apart = np.sqrt(3.0) * np.abs(place[:, None] - place) / _TOGETHER
    together = (1.0 + apart) * np.exp(-apart)
    return np.linalg.cholesky((1.0 - _ALONE) * together + _ALONE * np.eye(len(place)))
