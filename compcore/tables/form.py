"""Forms of a compensation table (ISO/TR 16907, 9.2): reversal columns, increments.

ISO/TR 16907, 9.2: values of the two directions stand in two columns, or the second holds only their
difference, or there is one value of half the reversal that is added or taken off.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.tables.table import Table

F64 = NDArray[np.float64]
Reversal = Literal["columns", "difference", "single"]
"""
============== ==============================================================
``columns``     values on the way up, values on the way down
``difference``  values on the way up, and down minus up
``single``      mean values, and one number: half of up minus down, everywhere
============== ==============================================================
"""
Entries = Literal["absolute", "incremental"]


def reversal_columns(table: Table, reversal: Reversal) -> tuple[F64, F64]:
    """The two reversal columns of a table (9.2.3), each (n,), in its sign.

    >>> nodes = np.array([0.0, 50.0, 100.0])
    >>> up, down = np.array([0.0, 0.0015, 0.0019]), np.array([0.0008, 0.0022, 0.0025])
    >>> from abbe.compcore.tables import move
    >>> table = Table(move("X"), ("X",), (nodes,), up, down)
    >>> reversal_columns(table, "difference")[1].round(4).tolist()
    [0.0008, 0.0007, 0.0006]
    """
    up, down = table.forward, table.downward
    if reversal == "columns":
        return up, down
    if reversal == "difference":
        return up, down - up
    half = float(0.5 * (up - down).mean())
    return 0.5 * (up + down), np.full(up.shape, half)


def from_reversal(table: Table, second: F64, reversal: Reversal) -> Table:
    """The table with two directions from its forward values and a second reversal column."""
    first = table.forward
    if reversal == "columns":
        up, down = first, second
    elif reversal == "difference":
        up, down = first, first + second
    else:
        up, down = first + second, first - second
    return replace(table, forward=up, backward=None if np.array_equal(up, down) else down)


def to_single(table: Table) -> Table:
    """The nearest table whose reversal is a single value (9.2.3), the same everywhere."""
    if not table.directional:
        return table
    mean, half = reversal_columns(table, "single")
    return from_reversal(replace(table, forward=mean, backward=None), half, "single")


def increments(values: F64, nodes: F64, origin: float) -> F64:
    """Incremental values from absolute ones, counted from the origin outwards.

    Parameters
    ----------
    values, nodes
        (n,), the nodes increasing, mm or rad.
    origin
        Node at which counting starts; its own entry is the absolute value there.

    Returns
    -------
    (n,): above the origin the step from the node before, below it the step from the node after, so
    that each is the change on the way outwards.
    """
    at = _origin(nodes, origin)
    found = np.empty(len(values))
    found[at] = values[at]
    found[at + 1 :] = np.diff(values[at:])
    found[:at] = -np.diff(values[: at + 1])
    return found


def accumulated(steps: F64, nodes: F64, origin: float) -> F64:
    """Absolute values from incremental ones, (n,), as `increments` gives them."""
    at = _origin(nodes, origin)
    found = np.empty(len(steps))
    found[at:] = np.cumsum(steps[at:])
    found[: at + 1] = np.cumsum(steps[at::-1])[::-1]
    return found


def _origin(nodes: F64, origin: float) -> int:
    at = int(np.abs(nodes - origin).argmin())
    if abs(nodes[at] - origin) > 1e-9 * (1.0 + abs(origin)):
        raise InputError(
            "increments count from a point of the table", field="origin", found=origin,
            expected=f"one of its points, e.g. {nodes[at]:g}",
        )  # fmt: skip
    return at
