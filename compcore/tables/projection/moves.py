"""Axis, cross, product and plane tables: moves of the axes themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.structure import Structure
from abbe.compcore.tables.capability import Capability
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.projection.choice import chosen
from abbe.compcore.tables.projection.curves.curve import Curve, fit_tables
from abbe.compcore.tables.projection.curves.marginal import Marginal
from abbe.compcore.tables.projection.orientation import constant_turns, turning_curves
from abbe.compcore.tables.projection.plane import plane_tables
from abbe.compcore.tables.projection.present import (
    MadeTables,
    curves_added,
    positions_beside,
    products_counted_for,
)
from abbe.compcore.tables.projection.products import product_curves
from abbe.compcore.tables.projection.single_axes import axis_curves, marginals_beside
from abbe.compcore.tables.table import Table, move
from abbe.compcore.tables.volume import Volume

F64 = NDArray[np.float64]


def move_tables(
    field: ErrorField,
    volume: Volume,
    capability: Capability,
    tolerance: float,
    present: Sequence[Table],
    *,
    orientation: bool,
) -> MadeTables:
    """Tables over the positions of one axis, or of two, that move X, Y, Z or turn a rotary axis.

    Parameters
    ----------
    field
        The error that is to be compensated.
    volume
        Where it counts.
    capability
        The families of tables, and how many of them there are.
    tolerance
        Interpolation error at the functional point that is small enough, mm.
    present
        Tables of errors that are in the controller.
    orientation
        Whether tables of rotary axes hold the tool's direction too.
    """
    capability = _for_axes_there(capability, field.model.machine.structure)

    def fine(axis: str) -> F64:
        return positions_beside(field, axis, present)

    turns, no_turns = turning_curves(field, volume, capability, fine, orientation=orientation)
    mean, marginals = marginals_beside(turns, field, volume, capability, fine)
    curves, notes, left = _wanted(capability, marginals, volume, present)
    kept, no_room = chosen(curves, capability, turns)
    notes += _no_table([*no_turns, *no_room])
    total, left = curves_added([*turns, *_with_constant(kept, mean)], left)
    tables, remarks = fit_tables(total, capability, tolerance)
    notes += remarks
    notes += constant_turns(turns, tables) if orientation else []
    for holds in capability.holds:
        if holds.form == "plane":
            over_two, remarks, left = plane_tables(field, volume, holds, tables, tolerance, left)
            tables += over_two
            notes += remarks
    return MadeTables(tuple(tables), tuple(notes), tuple(left))


def _for_axes_there(capability: Capability, structure: Structure) -> Capability:
    """The capability without tables that would correct an axis that the machine has not."""
    there = (*structure.carrying, *structure.rotary)
    holds = [
        replace(h, outputs=tuple(o for o in h.outputs or there if o in there))
        for h in capability.holds
    ]
    return replace(capability, holds=tuple(h for h in holds if h.outputs))


def _wanted(
    capability: Capability,
    marginals: Mapping[str, Marginal],
    volume: Volume,
    present: Sequence[Table],
) -> tuple[list[Curve], list[str], list[Table]]:
    """The curves of all families, what these have no table for, and the controller's tables.

    Of the last, products are counted from where the curves count.
    """
    curves: list[Curve] = []
    notes: list[str] = []
    held = list(present)
    for holds in capability.holds:
        if holds.form in ("axis", "cross"):
            found, left_out = axis_curves(holds, marginals, volume)
            curves += found
            notes += _no_table(left_out)
        elif holds.form == "product":
            held = products_counted_for(holds, held, volume)
            curves += product_curves(holds, marginals, volume, held)
    return curves, notes, held


def _no_table(curves: Sequence[Curve]) -> list[str]:
    names = ", ".join(c.table().name for c in curves)
    return [f"the controller has no table for {names}"] if curves else []


def _with_constant(curves: Sequence[Curve], mean: F64) -> list[Curve]:
    """The mean over the volume goes into an axis's own table, or the first that moves it."""
    total = list(curves)
    for k, output in enumerate("XYZ"):
        mine = [i for i, c in enumerate(total) if c.output == move(output) and c.lever is None]
        if mine:
            i = min(mine, key=lambda i: total[i].axis != output)
            total[i] = replace(total[i], values=total[i].values + mean[k])
    return total
