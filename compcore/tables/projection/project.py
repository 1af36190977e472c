"""Projection of an error field onto the tables that a controller can hold: least residual error."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.tables.capability import Capability, Holds
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.grid import spatial_grid
from abbe.compcore.tables.projection.choice import chosen
from abbe.compcore.tables.projection.curve import Curve, fit_tables
from abbe.compcore.tables.projection.marginal import fine_positions
from abbe.compcore.tables.projection.motions import LETTERS, axis_motions
from abbe.compcore.tables.projection.plane import plane_tables
from abbe.compcore.tables.projection.products import counted_from, lever_origin, product_curves
from abbe.compcore.tables.projection.single_axes import (
    axis_curves,
    longest_lever,
    marginals_beside,
    turning_curves,
)
from abbe.compcore.tables.table import Sign, Table, move
from abbe.compcore.tables.volume import Volume

F64 = NDArray[np.float64]

TOLERANCE = 1e-4
"""mm: interpolation error at the functional point that points need not better."""
_GRID_POINTS = 11


@dataclass(frozen=True)
class Projection:
    """The result of a projection: tables, and notes where the controller's limits were felt.

    Attributes
    ----------
    tables
        Errors, in whole steps of what the controller stores.
    notes
        Where its limits were felt.
    """

    tables: tuple[Table, ...]
    notes: tuple[str, ...] = ()


def project(
    field: ErrorField,
    volume: Volume,
    capability: Capability,
    *,
    points: int | None = None,
    tolerance: float = TOLERANCE,
    present: Sequence[Table] = (),
) -> Projection:
    """The tables of a controller that leave least of a field over a volume, in the mean square.

    Parameters
    ----------
    field
        The error that is to be compensated.
    volume
        Where it counts. Tables reach over the whole travel of their own axis.
    capability
        What the controller can hold.
    points
        Most points of a table (a grid: along each axis); None: as many as it takes.
    tolerance
        Interpolation error at the functional point that is small enough, mm; with `points` given,
        all of them are used.
    present
        Tables that are active in the controller while the field was measured: the new ones are
        added to them.

    Raises
    ------
    InputError
        When `points` is more than the controller can hold, or a table is present that it cannot
        hold.
    """
    present = [t.as_sign(Sign.ERROR) for t in present]
    job = _Job(field, volume, _with_points(capability, points), present)
    job.tolerance = tolerance if points is None else 0.0
    if (grid := job.capability.form("grid")) is not None:
        return job.grid(grid, points)
    if (motions := job.capability.form("motions")) is not None:
        return job.motions(motions)
    return job.moves()


def _with_points(capability: Capability, points: int | None) -> Capability:
    if points is None:
        return capability
    most = max(h.points for h in capability.holds)
    if not 2 <= points <= most:
        raise InputError("too many points, or too few", field="points", found=points,
                         expected=f"2 to {most}")  # fmt: skip
    holds = tuple(replace(h, points=min(points, h.points)) for h in capability.holds)
    return replace(capability, holds=holds)


class _Job:
    def __init__(
        self,
        field: ErrorField,
        volume: Volume,
        capability: Capability,
        present: Sequence[Table],
    ) -> None:
        self.field, self.volume, self.capability = field, volume, capability
        self.machine = field.model.machine
        self.axes = self.machine.structure.axes
        self.present = list(present)
        self.tolerance = 0.0
        self.notes: list[str] = []

    # -- moves of the axes themselves -----------------------------------------------------------

    def moves(self) -> Projection:
        """Axis, cross, product and plane tables."""
        turns = turning_curves(self.field, self.volume, self.capability, self._fine)
        mean, marginals = marginals_beside(
            turns, self.field, self.volume, self.capability, self._fine
        )
        planes = [h for h in self.capability.holds if h.form == "plane"]
        curves: list[Curve] = []
        for holds in self.capability.holds:
            if holds.form in ("axis", "cross"):
                found, left_out = axis_curves(holds, marginals, self.volume)
                curves += found
                self._not_made(left_out)
            elif holds.form == "product":
                self._count_present_from(holds)
                curves += product_curves(holds, marginals, self.volume, self.present)
        kept, left_out = chosen(curves, self.capability, turns)
        self._not_made(left_out)
        self._give_constant(kept, mean)
        tables, notes = fit_tables(
            self._with_present([*turns, *kept]), self.capability, self.tolerance
        )
        self.notes += notes
        made = list(tables)
        for holds in planes:
            over_two, notes = plane_tables(
                self.field, self.volume, holds, made, self.tolerance, self.present
            )
            made += over_two
            self.notes += notes
        return self._done(made)

    def _fine(self, axis: str) -> F64:
        more = [n for t in self.present for a, ns in zip(t.inputs, t.nodes, strict=True)
                if a == axis for n in ns]  # fmt: skip
        return fine_positions(self.field, axis, more)

    def _not_made(self, curves: Sequence[Curve]) -> None:
        if curves:
            names = ", ".join(c.table().name for c in curves)
            self.notes.append(f"the controller has no table for {names}")

    def _give_constant(self, curves: list[Curve], mean: F64) -> None:
        """The mean over the volume goes into an axis's own table, or the first that moves it."""
        for k, output in enumerate("XYZ"):
            mine = [c for c in curves if c.output == move(output) and c.lever is None]
            mine.sort(key=lambda c: c.axis != output)
            if mine:
                i = next(i for i, c in enumerate(curves) if c is mine[0])
                curves[i] = replace(mine[0], values=mine[0].values + mean[k])

    # -- tables of a controller that knows levers -------------------------------------------------

    def motions(self, holds: Holds) -> Projection:
        """Six tables an axis."""
        axes = [a for a in self.axes if holds.serves(a, a)]
        found = axis_motions(self.field, self.volume, {a: self._fine(a) for a in axes})
        curves = [
            Curve(
                holds,
                ErrorMotion(axis, letter),
                axis,
                found[axis].positions,
                found[axis].values[:, :, k],
                longest_lever(self.field, self.volume) if letter in "ABC" else 1.0,
            )
            for axis in axes
            for k, letter in enumerate(LETTERS)
        ]
        tables, notes = fit_tables(self._with_present(curves), self.capability, self.tolerance)
        self.notes += notes
        return self._done(tables)

    # -- spatial grids ----------------------------------------------------------------------------

    def grid(self, holds: Holds, points: int | None) -> Projection:
        """A grid over X, Y, Z, and one over the rotary axes where there are two or one."""
        count = min(points or _GRID_POINTS, holds.points)
        made: list[Table] = []
        for axes in (tuple("XYZ"), self.machine.structure.rotary[:3]):
            if not axes:
                continue
            nodes = {a: self._grid_nodes(holds, a, count) for a in axes}
            made += spatial_grid(self.field.model, self.field.state, nodes)
        rounded = [_rounded(t, holds) for t in self._sum(made)]
        return self._done(rounded)

    def _grid_nodes(self, holds: Holds, axis: str, count: int) -> F64:
        nodes = np.linspace(*self.volume.ranges[axis], count)
        unit = holds.spacing_of(axis).unit
        return np.asarray(np.rint(nodes / unit) * unit) if unit > 0.0 else nodes

    # -- what is in the controller already --------------------------------------------------------

    def _with_present(self, curves: Iterable[Curve]) -> list[Curve]:
        total = []
        for curve in curves:
            for table in list(self.present):
                if table.same_number(curve.table()):
                    curve = curve.plus(table)
                    self.present.remove(table)
            total.append(curve)
        return total

    def _count_present_from(self, holds: Holds) -> None:
        """Products in the controller as they count here; what that leaves has no lever."""
        self.present = [
            part
            for table in self.present
            for part in (
                (table,)
                if table.lever is None
                else counted_from(table, lever_origin(holds, self.volume, table.lever[0]))
            )
        ]

    def _sum(self, made: Sequence[Table]) -> list[Table]:
        total = []
        for table in made:
            for held in list(self.present):
                if held.same_number(table):
                    table = table.plus(held)
                    self.present.remove(held)
            total.append(table)
        return total

    def _done(self, tables: Sequence[Table]) -> Projection:
        if self.present:
            raise InputError(
                "a table that is in the controller has no counterpart among those to be written",
                field="on",
                found=", ".join(t.name for t in self.present),
                expected=", ".join(t.name for t in tables),
            )
        return Projection(tuple(tables), tuple(self.notes))


def _rounded(table: Table, holds: Holds) -> Table:
    step = holds.step(table.output.rotation)
    if step <= 0.0:
        return table
    return replace(table, forward=np.rint(table.forward / step) * step)
