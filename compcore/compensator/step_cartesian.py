"""The live step of a machine with three square linear axes: the lever rule folded into the tables.

To first order the error is affine in each position that makes up a lever:
``e = T + x·U_x + y·U_y + z·U_z``, T and U sums of functions of one position each. An axis's angles
never move the functional point along the axis that makes the lever, so U_x has no X component:
nine functions in all, and one look-up an axis gives its part of all nine.
"""

from __future__ import annotations

import itertools
from bisect import bisect_right
from collections.abc import Callable, Sequence
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.compensator.folding.tables import DirectionTable, FoldedAxisTable, FoldedTables
from abbe.compcore.compensator.scalar import lazy_rows, one_row, phases, scalar_products, sign

F64 = NDArray[np.float64]
Triple = tuple[float, float, float]
Step = Callable[[Sequence[float], Sequence[float]], Triple]

_LEVERS = ((1, 0), (2, 0), (0, 1), (2, 1), (0, 2), (1, 2))
"""(axis that makes the lever, component of the error) in the order of a row, after X Y Z of T."""


def nine(at_zero: F64, per_mm: F64, axes: Sequence[str]) -> F64 | None:
    """What a unit of each error motion adds to the nine functions, (motions, 9).

    Parameters
    ----------
    at_zero
        Moves of X, Y, Z per unit of each error motion with all axes at zero, (3, motions).
    per_mm
        Their change per mm of each axis, (axes, 3, motions), axes in the structure's order.

    Returns
    -------
    None where the machine is not one of three square linear axes.
    """
    if sorted(axes) != ["X", "Y", "Z"]:
        return None
    order = [list(axes).index(letter) for letter in "XYZ"]
    per_mm = per_mm[order]
    if any(np.any(per_mm[k, k]) for k in range(3)):
        return None
    return np.stack([*at_zero, *(per_mm[lever, k] for lever, k in _LEVERS)], axis=1)


def cartesian_step(tables: FoldedTables, shares: F64, axes: Sequence[str]) -> Step:
    """The step, from tables and what `nine` gave (`shares`)."""
    order = [list(axes).index(letter) for letter in "XYZ"]
    pick = itemgetter(*order)
    find = bisect_right
    nodes: list[list[float]] = [[0.0]] * 3
    matrices: list[F64] = [np.zeros((2, 18))] * 3
    for table, columns in tables.tables:
        if isinstance(table, FoldedAxisTable):
            share = shares[list(columns)]
            k = order.index(table.axis)
            nodes[k] = table.nodes.tolist()
            matrices[k] = np.concatenate([table.intercept @ share, table.slope @ share], axis=1)
    constant = np.concatenate([tables.constant @ shares, np.zeros(9)])
    nx, ny, nz = nodes
    rx, fetch_x = lazy_rows(matrices[0] + constant)
    ry, fetch_y = lazy_rows(matrices[1])
    rz, fetch_z = lazy_rows(matrices[2])

    def plain(positions: Sequence[float], _: Sequence[float]) -> Triple:
        x, y, z = pick(positions)
        i = find(nx, x)
        a1, a2, a3, a4, a5, a6, a7, a8, a9, s1, s2, s3, s4, s5, s6, s7, s8, s9 = rx[i] or fetch_x(i)
        i = find(ny, y)
        b1, b2, b3, b4, b5, b6, b7, b8, b9, t1, t2, t3, t4, t5, t6, t7, t8, t9 = ry[i] or fetch_y(i)
        i = find(nz, z)
        c1, c2, c3, c4, c5, c6, c7, c8, c9, u1, u2, u3, u4, u5, u6, u7, u8, u9 = rz[i] or fetch_z(i)
        return (
            (a1 + s1 * x + b1 + t1 * y + c1 + u1 * z)
            + y * (a4 + s4 * x + b4 + t4 * y + c4 + u4 * z)
            + z * (a5 + s5 * x + b5 + t5 * y + c5 + u5 * z),
            (a2 + s2 * x + b2 + t2 * y + c2 + u2 * z)
            + x * (a6 + s6 * x + b6 + t6 * y + c6 + u6 * z)
            + z * (a7 + s7 * x + b7 + t7 * y + c7 + u7 * z),
            (a3 + s3 * x + b3 + t3 * y + c3 + u3 * z)
            + x * (a8 + s8 * x + b8 + t8 * y + c8 + u8 * z)
            + y * (a9 + s9 * x + b9 + t9 * y + c9 + u9 * z),
        )

    by_directions = _by_directions(tables, shares, len(axes))
    more = [(value, shares[k].tolist()) for value, k in phases(tables)]
    products = [
        (scalar_products(bundle), shares[list(bundle.error_motions)].tolist())
        for bundle in tables.products
    ]
    direct = tables.direct
    if by_directions is None and not more and not products and direct is None:
        return plain

    def step(positions: Sequence[float], directions: Sequence[float]) -> Triple:
        ex, ey, ez = plain(positions, directions)
        x, y, z = pick(positions)
        if by_directions is not None:
            key = tuple(directions)
            d = by_directions.get(key) or by_directions[tuple(map(sign, key))]
            ex += d[0] + y * d[3] + z * d[4]
            ey += d[1] + x * d[5] + z * d[6]
            ez += d[2] + x * d[7] + y * d[8]
        for value, m in more:
            v = value(positions, directions)
            ex += v * (m[0] + y * m[3] + z * m[4])
            ey += v * (m[1] + x * m[5] + z * m[6])
            ez += v * (m[2] + x * m[7] + y * m[8])
        for values, each in products:
            for v, m in zip(values(positions, directions), each, strict=True):
                ex += v * (m[0] + y * m[3] + z * m[4])
                ey += v * (m[1] + x * m[5] + z * m[6])
                ez += v * (m[2] + x * m[7] + y * m[8])
        if direct is not None:
            d = (direct(*one_row(positions, directions))[0] @ shares).tolist()
            ex += d[0] + y * d[3] + z * d[4]
            ey += d[1] + x * d[5] + z * d[6]
            ez += d[2] + x * d[7] + y * d[8]
        return ex, ey, ez

    return step


def _by_directions(
    tables: FoldedTables, shares: F64, count: int
) -> dict[tuple[float, ...], list[float]] | None:
    """What directions alone add to the nine functions, for every combination of directions."""
    directed = [
        (table.axis, table.values @ shares[list(columns)])
        for table, columns in tables.tables
        if isinstance(table, DirectionTable)
    ]
    if not directed:
        return None
    found: dict[tuple[float, ...], list[float]] = {}
    for signs in itertools.product((0, 1, -1), repeat=count):
        found[signs] = sum(part[signs[axis]] for axis, part in directed).tolist()
    found[()] = found[(0,) * count]
    return found
