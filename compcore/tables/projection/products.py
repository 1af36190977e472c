"""Product tables: an angle of one axis times the position of another as its lever (L-ANG)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.tables.capability import Holds
from abbe.compcore.tables.projection.curves.curve import Curve
from abbe.compcore.tables.projection.curves.marginal import Marginal
from abbe.compcore.tables.table import Table, move
from abbe.compcore.tables.volume import Volume

F64 = NDArray[np.float64]

_NOTHING = 5e-5
"""mm: a product that does less anywhere is no use to a table, half of what interpolation costs."""


def lever_origin(holds: Holds, volume: Volume, lever: str) -> float:
    """The origin of a lever, mm: the middle of its range, rounded to the table's unit of position.

    Counted from there a product is orthogonal to the tables over single axes: neither spoils the
    other.
    """
    unit = holds.spacing_of(lever).unit
    middle = volume.middle(lever)
    return round(round(middle / unit) * unit, 9) if unit > 0.0 else middle


def product_curves(
    holds: Holds,
    marginals: Mapping[str, Marginal],
    volume: Volume,
    present: Sequence[Table] = (),
) -> list[Curve]:
    """The curves of product tables; what two of them have in common counts once.

    Parameters
    ----------
    holds
        The family.
    marginals
        Axis → how the error depends on it, with its slopes over the other axes.
    volume
        The working volume.
    present
        Tables in the controller, counted from `lever_origin`: their products are kept, however
        little they do.
    """
    kept = {(t.output, t.inputs, t.lever) for t in present}
    found = []
    for k, output in enumerate("XYZ"):
        taken: set[frozenset[str]] = set()
        for axis, part in marginals.items():
            if not holds.serves(axis, output):
                continue
            inside = volume.inside(axis, part.positions)
            for lever, slope in part.slope.items():
                if is_rotary(lever):
                    continue
                values = slope[:, :, k]
                values = values - values[:, inside].mean()
                pair = frozenset((axis, lever))
                if pair in taken:
                    # the twisted plane, both axes' product, is in the first of the two
                    offset = part.positions - volume.middle(axis)
                    even = values.mean(axis=0)[inside] @ offset[inside]
                    values = values - even / (offset[inside] @ offset[inside]) * offset
                taken.add(pair)
                reach = volume.half(lever)
                about = (lever, lever_origin(holds, volume, lever))
                number = (move(output), (axis,), about)
                if np.abs(values).max() * reach > _NOTHING or number in kept:
                    found.append(
                        Curve(holds, move(output), axis, part.positions, values, reach, about)
                    )
    return found


def counted_from(table: Table, origin: float) -> tuple[Table, ...]:
    """A product table with another lever origin, and the table without a lever that this leaves."""
    if table.lever is None or table.lever[1] == origin:
        return (table,)
    axis, before = table.lever
    constant = replace(table.scaled(origin - before), lever=None)
    return (replace(table, lever=(axis, origin)), constant)
