"""Tables over the positions of two axes (planes), equidistant in both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.tables.capability import Holds
from abbe.compcore.tables.field import ErrorField
from abbe.compcore.tables.projection.curves.hats import operator
from abbe.compcore.tables.projection.curves.nodes import place
from abbe.compcore.tables.projection.curves.quantise import quantise
from abbe.compcore.tables.projection.present import counterparts
from abbe.compcore.tables.table import Table, move
from abbe.compcore.tables.volume import Volume
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_SCAN = 97
_LINES = 5
_ROWS = 80_000


def plane_tables(
    field: ErrorField,
    volume: Volume,
    holds: Holds,
    besides: Sequence[Table],
    tolerance: float,
    present: Sequence[Table],
) -> tuple[list[Table], list[str], list[Table]]:
    """Tables over two inputs, one for each output of a family: the mean over the other axes.

    What is wanted of them is the mean over all other axes of what other tables leave, which of all
    functions of two axes leaves least (see `abbe.compcore.tables.projection.curves.marginal`).

    Parameters
    ----------
    besides
        Tables that the controller holds as well.
    present
        Tables in the controller.

    Returns
    -------
    The tables, notes where the controller's limits were felt, and those of `present` that none of
    the tables stands for.
    """
    first, second = holds.inputs or ("X", "Y")
    machine = field.model.machine
    carrying = machine.structure.carrying
    outputs = tuple(o for o in holds.outputs or carrying if o in carrying)
    rest = [a for a in machine.structure.axes if a not in (first, second)]
    few = 7 if len(rest) <= 2 else 31

    def mean(a: F64, b: F64) -> F64:
        """Mean over the rest on a grid, (len(a), len(b), 3)."""
        spread = volume.spread(rest, few) if rest else {}
        n = len(next(iter(spread.values()))) if rest else 1
        pairs = np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1).reshape(-1, 2)
        where = {first: np.repeat(pairs[:, 0], n), second: np.repeat(pairs[:, 1], n)}
        where.update({k: np.tile(v, len(pairs)) for k, v in spread.items()})
        left = field(where) - field.removed(besides, where)
        return np.asarray(left.reshape(len(a), len(b), n, 3).mean(axis=2))

    index = ["XYZ".index(o) for o in outputs]
    nodes = []
    for axis, other in ((first, second), (second, first)):
        scan = np.linspace(*machine.axis(axis).travel, _SCAN)
        lines = np.linspace(*volume.ranges[other], _LINES)
        found = mean(scan, lines) if axis == first else mean(lines, scan)
        along = found[:, :, index] if axis == first else np.moveaxis(found[:, :, index], 1, 0)
        curves = along.reshape(_SCAN, -1).T
        nodes.append(place(scan, curves, holds.spacing_of(axis), holds.points, tolerance))
    finer = 3 if 9 * len(nodes[0]) * len(nodes[1]) * few <= _ROWS else 1
    fine = [_refined(n, finer) for n in nodes]
    values = mean(*fine)
    fits = [operator(f, n) for f, n in zip(fine, nodes, strict=True)]
    tables, notes, unmatched = [], [], list(present)
    for k, output in zip(index, outputs, strict=True):
        wanted = fits[0] @ values[:, :, k] @ fits[1].T
        table = Table(move(output), (first, second), (nodes[0], nodes[1]), wanted)
        same, unmatched = counterparts(table, unmatched)
        for held in same:
            table = replace(table, forward=table.forward + held.on(*nodes).forward)
        flat = table.forward.reshape(-1)
        steps = quantise(
            flat, np.arange(float(flat.size)), holds.resolution, value_range=holds.value_range
        )
        table = replace(table, forward=steps.values.reshape(wanted.shape))
        if steps.limited > 0.0:
            notes.append(
                f"{table.name}: the range of the controller's entries cuts off up to "
                f"{in_digits(steps.limited * 1e3)} µm"
            )
        tables.append(table)
    return tables, notes, unmatched


def _refined(nodes: F64, times: int) -> F64:
    """Every interval divided into so many parts."""
    index = np.arange((len(nodes) - 1) * times + 1) / times
    return np.interp(index, np.arange(len(nodes)), nodes)
