"""Tables that a controller holds already: what is made is added to those of the same number."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.tables.capability import Holds
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.projection.curves.curve import Curve
from abbe.compcore.tables.projection.curves.marginal import fine_positions
from abbe.compcore.tables.projection.products import counted_from, lever_origin
from abbe.compcore.tables.table import Table
from abbe.compcore.tables.volume import Volume

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class MadeTables:
    """Tables that are made, before it is asked whether they replace all that are there.

    Attributes
    ----------
    tables
        Errors, in whole steps of what the controller stores.
    notes
        Where its limits were felt.
    left
        Tables in the controller that none of these stands for.
    """

    tables: tuple[Table, ...]
    notes: tuple[str, ...]
    left: tuple[Table, ...]


def positions_beside(field: ErrorField, axis: str, present: Sequence[Table]) -> F64:
    """Fine positions over an axis's travel, (m,), mm or rad, the controller's nodes among them."""
    nodes = [
        position
        for table in present
        for looked_up, positions in zip(table.inputs, table.nodes, strict=True)
        if looked_up == axis
        for position in positions
    ]
    return fine_positions(field, axis, nodes)


def counterparts(table: Table, present: Sequence[Table]) -> tuple[list[Table], list[Table]]:
    """Of the tables in the controller those of the same number as one, and the others."""
    same = [held for held in present if held.same_number(table)]
    return same, [held for held in present if not held.same_number(table)]


def curves_added(
    curves: Iterable[Curve], present: Sequence[Table]
) -> tuple[list[Curve], list[Table]]:
    """Curves with the controller's tables added, and the tables that no curve stands for."""
    total, left = [], list(present)
    for curve in curves:
        same, left = counterparts(curve.table(), left)
        for held in same:
            curve = curve.plus(held)
        total.append(curve)
    return total, left


def tables_added(
    tables: Iterable[Table], present: Sequence[Table]
) -> tuple[list[Table], list[Table]]:
    """Tables with the controller's added, on the nodes of both, and those without a counterpart."""
    total, left = [], list(present)
    for table in tables:
        same, left = counterparts(table, left)
        for held in same:
            table = table.plus(held)
        total.append(table)
    return total, left


def products_counted_for(holds: Holds, present: Sequence[Table], volume: Volume) -> list[Table]:
    """The controller's tables, products with levers that count from where those to be made do.

    What a move of a lever's origin leaves over is a table without a lever.
    """
    parts: list[Table] = []
    for table in present:
        if table.lever is None:
            parts.append(table)
        else:
            parts += counted_from(table, lever_origin(holds, volume, table.lever[0]))
    return parts
