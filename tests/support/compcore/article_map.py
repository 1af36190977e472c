"""The published step-by-step way of applying a map, written independently of compcore.

Each axis in the chain's order: its linear errors are added; its rotations, about the current axes
in the order X, Y, Z, join those before; what is accumulated turns the vector to the next axis.
Vendors' variations are arguments.
"""

from __future__ import annotations

import numpy as np

from tests.support.compcore.rigid_body import turn

UNIT = {"X": np.array([1.0, 0, 0]), "Y": np.array([0, 1.0, 0]), "Z": np.array([0, 0, 1.0])}


def random_tables(rng, linear_mm=5e-3, angular_rad=30e-6):
    """Axis → (positions (n,), values (n, 6) in mm and rad); Z falling, as in the published map."""
    tables = {}
    for axis, low, high, rows in (("X", 0, 700, 8), ("Y", 0, 900, 10), ("Z", 0, -360, 7)):
        values = rng.uniform(-1, 1, (rows, 6)) * ([linear_mm] * 3 + [angular_rad] * 3)
        tables[axis] = (np.linspace(low, high, rows), values)
    return tables


def as_map(tables):
    """The same tables as compcore holds them."""
    from abbe.compcore.maps.table import AxisTable, CompensationMap

    return CompensationMap(
        {
            axis: AxisTable(axis, tuple(at.tolist()), tuple(map(tuple, values.tolist())))
            for axis, (at, values) in tables.items()
        }
    )


def interpolated(table, position):
    at, values = table
    order = np.argsort(at)
    return np.array([np.interp(position, at[order], values[order, k]) for k in range(6)])


def correction(
    tables,
    chain,
    position,
    tool=(0.0, 0.0, 0.0),
    *,
    sign=lambda axis, k: 1.0,
    rotation_point=None,
    own_travel=(),
):
    """Correction (3,) in mm at one point.

    `sign` of (axis, column 0 … 5); `rotation_point` axis → mm from which its travel counts as a
    lever; `own_travel`: axes whose angular errors turn their own travel too.
    """
    zero = rotation_point or {}
    total, rotation = np.zeros(3), np.eye(3)
    for i, axis in enumerate(chain):
        row = interpolated(tables[axis], position[axis])
        row = np.array([row[k] * sign(axis, k) for k in range(6)])
        total = total + row[:3]
        own = turn("A", row[3]) @ turn("B", row[4]) @ turn("C", row[5])
        rotation = rotation @ own[:3, :3]
        moves = [axis] if axis in own_travel else []
        if i + 1 < len(chain) and chain[i + 1] not in own_travel:
            moves.append(chain[i + 1])
        for other in moves:
            v = (position[other] - zero.get(other, 0.0)) * UNIT[other]
            total = total + rotation @ v - v
    return total + rotation @ np.asarray(tool) - tool
