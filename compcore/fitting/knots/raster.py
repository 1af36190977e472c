"""Splines on a fine raster: the finest that an effect with knots to be found could get."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.shapes import AUTO, CUBIC, Shape
from abbe.compcore.machine.machine import Axis
from abbe.compcore.model.model import Model, Term, Value

F64 = NDArray[np.float64]

GRID = 121
"""Places along the travel at which curves with different knots are laid beside each other."""
_PARTS = (12, 30)
"""Least and greatest number of parts of the raster."""
_COLUMNS = 600
"""About so many coefficients of the raster in all."""


def finds_knots(effect: Effect) -> bool:
    """Whether a fit is to find an effect's knots."""
    return getattr(effect, "shape", None) == AUTO


def on_raster(model: Model) -> Model:
    """The model with the finest splines in the place of those whose knots are to be found."""
    count = sum(map(finds_knots, model.effects))
    parts = int(np.clip(_COLUMNS // max(count, 1) - CUBIC, *_PARTS))
    shape = {"shape": f"spline:{parts + CUBIC}", "positions": ()}
    terms = tuple(
        Term(t.effect.model_copy(update=shape)) if finds_knots(t.effect) else t for t in model.terms
    )
    return replace(model, terms=terms, covariance=None)


def auto_shape(effect: Effect, axis: Axis) -> Shape:
    """The shape of an effect with the knots that it has, along an axis."""
    unit = np.pi / 180.0 if axis.rotary else 1.0
    return Shape.parse(AUTO, tuple(p * unit for p in getattr(effect, "positions", ())))


@dataclass(frozen=True)
class RasterCurve:
    """An effect on the raster: its cubic, and a column for each place of a knot.

    Attributes
    ----------
    term
        Its index in the model.
    axis
        Along which it runs.
    places
        Inner places of the raster, (J,), mm or degrees as a model file has them.
    cubic, powers
        Coefficients on the raster of a cubic's four functions, (parts + 3, 4), and of the cubic
        beyond each place, (parts + 3, J).
    unit, scale
        Of its coefficients inside the code; a believable size of one.
    """

    term: int
    axis: Axis
    places: F64
    cubic: F64
    powers: F64
    unit: str
    scale: float

    @classmethod
    def of(cls, term: int, fine: Effect, axis: Axis, unit: str, scale: float) -> RasterCurve:
        """From an effect of `on_raster`; `unit` and `scale` are those of its coefficients."""
        shape = Shape.parse(str(getattr(fine, "shape", "")))
        parts = shape.order - CUBIC
        x = np.linspace(-1.0, 1.0, 8 * parts + 1)
        q = axis.middle + axis.half_travel * x
        raster = shape.basis(q, axis)
        inner = np.arange(1, parts) / parts
        places = axis.travel[0] + 2.0 * axis.half_travel * inner
        part = 0.5 * (x + 1.0)[:, None]
        powers = np.clip((part - inner) / (1.0 - inner), 0.0, None) ** 3
        wanted = np.column_stack([legendre.legvander(x, CUBIC), powers])
        found = np.asarray(np.linalg.lstsq(raster, wanted, rcond=None)[0], dtype=np.float64)
        shown = np.degrees(places) if axis.rotary else places
        cubic, beyond = found[:, : CUBIC + 1], found[:, CUBIC + 1 :]
        return cls(term, axis, np.round(shown, 3), cubic, beyond, unit, scale)

    def with_knots(self, term: Term, knots: tuple[float, ...]) -> Term:
        """The effect with knots; values that it had, as near as the new knots come."""
        effect = term.effect.model_copy(update={"positions": tuple(float(k) for k in knots)})
        if not term.values:
            return Term(effect)
        q = np.linspace(*self.axis.travel, GRID)
        old, new = auto_shape(term.effect, self.axis), auto_shape(effect, self.axis)
        values = old.basis(q, self.axis) @ np.array([term.values[n].value for n in old.names])
        found = np.linalg.lstsq(new.basis(q, self.axis), values, rcond=None)[0]
        return Term(effect, {n: Value(float(v)) for n, v in zip(new.names, found, strict=True)})
