"""Projection of an error field onto the tables that a controller can hold: least residual error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.tables.capability import Capability, Holds
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.grid import spatial_grid
from abbe.compcore.tables.projection.curves.curve import Curve, fit_tables
from abbe.compcore.tables.projection.motions import LETTERS, axis_motions
from abbe.compcore.tables.projection.moves import move_tables
from abbe.compcore.tables.projection.orientation import (
    longest_lever,
    require_corrected,
    require_turning,
)
from abbe.compcore.tables.projection.present import (
    MadeTables,
    curves_added,
    positions_beside,
    tables_added,
)
from abbe.compcore.tables.table import Sign, Table
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
    orientation: bool = False,
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
    orientation
        Whether tables of rotary axes hold the tool's direction; else their own positioning error
        only. What that takes off the direction may cost the point some of its accuracy, where
        tables over single axes cannot take the turn's move of the tip back.

    Raises
    ------
    InputError
        When no axis of the machine can carry what the controller holds, `points` is more than it
        can hold, a table is present that it cannot hold, or the direction is to be held by a
        controller or a machine that cannot.
    """
    require_corrected(field.model.machine.structure, capability)
    if orientation:
        require_turning(field.model.machine, capability)
    allowed = tolerance if points is None else 0.0
    capability = _with_points(capability, points)
    held = [t.as_sign(Sign.ERROR) for t in present]
    if (grid := capability.form("grid")) is not None:
        made = _grids(field, volume, grid, min(points or _GRID_POINTS, grid.points), held)
    elif (motions := capability.form("motions")) is not None:
        made = _six_an_axis(field, volume, capability, motions, allowed, held)
    else:
        made = move_tables(field, volume, capability, allowed, held, orientation=orientation)
    if made.left:
        raise InputError(
            "a table that is in the controller has no counterpart among those to be written",
            field="on",
            found=", ".join(t.name for t in made.left),
            expected=", ".join(t.name for t in made.tables),
        )
    return Projection(made.tables, made.notes)


def _with_points(capability: Capability, points: int | None) -> Capability:
    if points is None:
        return capability
    most = max(h.points for h in capability.holds)
    if not 2 <= points <= most:
        raise InputError("too many points, or too few", field="points", found=points,
                         expected=f"2 to {most}")  # fmt: skip
    holds = tuple(replace(h, points=min(points, h.points)) for h in capability.holds)
    return replace(capability, holds=holds)


def _six_an_axis(
    field: ErrorField,
    volume: Volume,
    capability: Capability,
    holds: Holds,
    tolerance: float,
    present: Sequence[Table],
) -> MadeTables:
    """Six tables an axis, for a controller that knows levers."""
    axes = [a for a in field.model.machine.structure.axes if holds.serves(a, a)]
    fine = {a: positions_beside(field, a, present) for a in axes}
    found = axis_motions(field, volume, fine)
    lever = longest_lever(field, volume)
    curves = [
        Curve(
            holds,
            ErrorMotion(axis, letter),
            axis,
            found[axis].positions,
            found[axis].values[:, :, k],
            lever if letter in "ABC" else 1.0,
        )
        for axis in axes
        for k, letter in enumerate(LETTERS)
    ]
    total, left = curves_added(curves, present)
    tables, notes = fit_tables(total, capability, tolerance)
    return MadeTables(tuple(tables), tuple(notes), tuple(left))


def _grids(
    field: ErrorField, volume: Volume, holds: Holds, count: int, present: Sequence[Table]
) -> MadeTables:
    """A grid over X, Y, Z, and one over the rotary axes where there are some, at most three."""
    made: list[Table] = []
    for axes in (field.model.machine.structure.carrying, field.model.machine.structure.rotary[:3]):
        if axes:
            nodes = {a: _grid_nodes(volume, holds, a, count) for a in axes}
            made += spatial_grid(field.model, field.state, nodes)
    total, left = tables_added(made, present)
    return MadeTables(tuple(_rounded(t, holds) for t in total), (), tuple(left))


def _grid_nodes(volume: Volume, holds: Holds, axis: str, count: int) -> F64:
    nodes = np.linspace(*volume.ranges[axis], count)
    unit = holds.spacing_of(axis).unit
    return np.asarray(np.rint(nodes / unit) * unit) if unit > 0.0 else nodes


def _rounded(table: Table, holds: Holds) -> Table:
    step = holds.step(table.output.rotation)
    if step <= 0.0:
        return table
    return replace(table, forward=np.rint(table.forward / step) * step)
