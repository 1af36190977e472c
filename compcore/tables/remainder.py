"""Residual error in the working volume, with a set of compensation tables and without."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.machine.machine import own_component
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.projection.motions import LETTERS
from abbe.compcore.tables.projection.orientation import lean, pointing_axes
from abbe.compcore.tables.table import Table
from abbe.compcore.tables.volume import Volume

F64 = NDArray[np.float64]

_POINTS = 2584


@dataclass(frozen=True, eq=False)
class Remainder:
    """The residual error over a volume, up to a shift of the whole, mm.

    A constant shift moves the datum along and is no error of a part: volumetric accuracy counts
    relative deviations (ISO 230-1:2012, 3.8.3). It is stated separately.

    Attributes
    ----------
    rms, p95, largest
        Of the length of the error vector, mm.
    shift
        The constant in X, Y, Z, mm.
    worst
        Axis → position where it is largest, mm or rad.
    positions
        Axis → positions of all points, (n,).
    errors
        (n, 3), mm, the shift taken off.
    lean_rms, lean_largest
        Of the angle by which the tool is tilted, rad; without a rotary axis that could turn it back
        no table changes it.
    """

    rms: float
    p95: float
    largest: float
    shift: F64
    worst: Mapping[str, float]
    positions: Mapping[str, F64]
    errors: F64
    lean_rms: float
    lean_largest: float


@dataclass(frozen=True, eq=False)
class TrialPoints:
    """Points of a volume with the error at each, on which sets of tables are compared.

    Attributes
    ----------
    field
        The error.
    positions, directions
        Axis → positions (mm or rad) and approach directions, each (n,).
    errors
        The field there, (n, 3), mm.
    """

    field: ErrorField
    positions: Mapping[str, F64]
    directions: Mapping[str, F64]
    errors: F64

    @classmethod
    def over(cls, field: ErrorField, volume: Volume, count: int = _POINTS) -> TrialPoints:
        """Points spread over a volume, approached from both sides where the error depends on it."""
        machine = field.model.machine
        where = volume.spread(machine.structure.axes, count)
        rng = np.random.default_rng(16907)
        n = len(next(iter(where.values())))
        facing = {a: rng.permutation(np.where(np.arange(n) % 2, 1.0, -1.0))
                  for a in field.reversing()}  # fmt: skip
        return cls(field, where, facing, field(where, facing))

    def remainder(self, tables: Iterable[Table] = ()) -> Remainder:
        """The residual error with a set of tables; without tables the error itself."""
        tables = tuple(tables)
        removed = self.field.removed(tables, self.positions, self.directions)
        left = self.errors - removed
        shift = left.mean(axis=0)
        left = left - shift
        length = np.linalg.norm(left, axis=1)
        worst = int(length.argmax())
        tilt = self._tilt(tables)
        return Remainder(
            rms=float(np.sqrt((length**2).mean())),
            p95=float(np.quantile(length, 0.95)),
            largest=float(length[worst]),
            shift=shift,
            worst={a: float(p[worst]) for a, p in self.positions.items()},
            positions=self.positions,
            errors=left,
            lean_rms=float(np.sqrt((tilt**2).mean())),
            lean_largest=float(tilt.max()),
        )

    def _tilt(self, tables: Sequence[Table]) -> F64:
        """By what the tool is tilted where tables turn rotary axes, (n,), rad.

        Error motions of other axes that a table holds are carried to the point through levers, and
        turn nothing.
        """
        machine = self.field.model.machine
        axes = pointing_axes(machine)
        tilt, columns = lean(self.field, self.positions, self.directions, axes)
        conditions = self.field.conditions(self.positions, self.directions)
        for k, axis in enumerate(axes):
            turn = ErrorMotion(axis, LETTERS["XYZABC".index(own_component(axis))])
            for table in tables:
                if table.output == turn:
                    tilt = tilt - columns[:, :, k] * table.value(conditions)[:, None]
        return np.asarray(np.linalg.norm(tilt, axis=1))
