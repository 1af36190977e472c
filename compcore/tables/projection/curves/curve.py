"""Tables from finely sampled compensation curves: nodes placed, values fitted and rounded."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.error_motion import ErrorMotion
from abbe.compcore.tables.capability import Capability, Holds
from abbe.compcore.tables.projection.curves.hats import deviation, operator
from abbe.compcore.tables.projection.curves.nodes import place
from abbe.compcore.tables.projection.curves.quantise import QuantisedValues, quantise
from abbe.compcore.tables.table import Table
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_SAME = 1e-9
"""mm: directions that differ less are alike."""


@dataclass(frozen=True, eq=False)
class Curve:
    """The values that a table is to hold, at fine positions, for both directions.

    Attributes
    ----------
    holds
        The family of tables that it is for.
    output, axis, lever
        As of the table (`abbe.compcore.tables.table.Table`); `axis` is its one input.
    positions
        (m,), mm or rad.
    values
        Upwards and downwards, (2, m), mm or rad.
    reach
        What one unit of the values does at the functional point, mm (a lever for angles, 1 else).
    """

    holds: Holds
    output: ErrorMotion
    axis: str
    positions: F64
    values: F64
    reach: float = 1.0
    lever: tuple[str, float] | None = None

    @property
    def directional(self) -> bool:
        """Whether the two directions differ."""
        return bool(np.abs(self.values[0] - self.values[1]).max() > _SAME)

    def table(self) -> Table:
        """The curve as one table with all its positions as nodes."""
        up, down = self.values
        backward = None if np.array_equal(up, down) else down
        return Table(self.output, (self.axis,), (self.positions,), up, backward, lever=self.lever)

    def plus(self, table: Table) -> Curve:
        """The curve with a table of errors added, whose nodes are among the positions."""
        up = table.at(self.positions)
        down = table.at(self.positions, upward=False)
        return replace(self, values=self.values + np.stack([up, down]))

    def onedirectional(self) -> Curve:
        """The curve with the mean of both directions for both."""
        return replace(self, values=np.broadcast_to(self.values.mean(axis=0), self.values.shape))

    def reaching(self, position: float) -> Curve:
        """The curve with one more position; its ends are held as far as that."""
        if position in self.positions:
            return self
        where = int(np.searchsorted(self.positions, position))
        here = [np.interp(position, self.positions, values) for values in self.values]
        return replace(
            self,
            positions=np.insert(self.positions, where, position),
            values=np.insert(self.values, where, here, axis=1),
        )


def fit_tables(
    curves: Sequence[Curve], capability: Capability, tolerance: float
) -> tuple[list[Table], list[str]]:
    """Tables within a controller's limits for some curves, and notes where limits were felt.

    Parameters
    ----------
    curves
        What they are to hold.
    capability
        The controller; each curve names its family of tables.
    tolerance
        Interpolation error at the functional point that is small enough, mm.
    """
    ready = []
    for curve in curves:
        holds = curve.holds
        if not holds.directional:
            curve = curve.onedirectional()
        if holds.zero_at == "zero":
            curve = curve.reaching(capability.reference.get(curve.axis, 0.0))
        ready.append(curve)
    groups: dict[tuple[str, int], list[Curve]] = {}
    for i, curve in enumerate(ready):
        groups.setdefault((curve.axis, 0 if capability.shared_nodes else i), []).append(curve)
    nodes: dict[int, F64] = {}
    for group in groups.values():
        shared = _nodes(group, capability, tolerance)
        nodes.update({id(curve): shared for curve in group})
    tables, notes = [], []
    fits: dict[tuple[int, int], F64] = {}
    for curve in ready:
        points = nodes[id(curve)]
        key = (id(points), id(curve.positions))
        if key not in fits:
            fits[key] = operator(curve.positions, points)
        table, remarks = _table(curve, points, fits[key], capability, tolerance)
        tables.append(table)
        notes += remarks
    return tables, notes


def _nodes(group: Sequence[Curve], capability: Capability, tolerance: float) -> F64:
    first = group[0]
    holds = first.holds
    positions = first.positions
    curves = np.concatenate([np.interp(positions, c.positions, v)[None] * c.reach
                             for c in group for v in _different(c)])  # fmt: skip
    through = capability.reference.get(first.axis, 0.0) if holds.zero_at == "zero" else None
    spacing = holds.spacing_of(first.axis)
    return place(positions, curves, spacing, holds.points, tolerance, through)


def _different(curve: Curve) -> Iterable[F64]:
    up, down = curve.values
    return (up, down) if curve.directional else (up,)


def _table(
    curve: Curve, nodes: F64, fit: F64, capability: Capability, tolerance: float
) -> tuple[Table, list[str]]:
    holds = curve.holds
    directions = list(_different(curve))
    wanted = [fit @ values for values in directions]
    zero: int | None = None
    shift = 0.0
    if holds.zero_at is not None:
        at = capability.reference.get(curve.axis, 0.0) if holds.zero_at == "zero" else nodes[0]
        nearest = int(np.abs(nodes - at).argmin())
        zero = nearest if abs(nodes[nearest] - at) <= 1e-9 * (1.0 + abs(at)) else None
        shift = float(np.interp(at, nodes, wanted[0]))
    wanted = [w - shift for w in wanted]
    steps = _steps(curve, nodes, wanted, zero)
    table = Table(
        curve.output,
        (curve.axis,),
        (nodes,),
        steps[0].values,
        steps[1].values if len(steps) == 2 else None,
        lever=curve.lever,
    )
    if table.backward is not None and np.array_equal(table.forward, table.backward):
        table = replace(table, backward=None)
    notes = []
    limited = max(s.limited for s in steps) * curve.reach
    if limited > 0.0:
        notes.append(
            f"{table.name}: the range of the controller's entries cuts off up to "
            f"{in_digits(limited * 1e3)} µm"
        )
    left = max(
        deviation(curve.positions, values - shift, nodes, want)
        for values, want in zip(directions, wanted, strict=True)
    )
    if left * curve.reach > max(2.0 * tolerance, 2e-4):
        notes.append(
            f"{table.name}: {len(nodes)} points leave up to "
            f"{in_digits(left * curve.reach * 1e3, 2)} µm between them"
        )
    return table, notes


def _steps(
    curve: Curve, nodes: F64, wanted: Sequence[F64], zero: int | None
) -> list[QuantisedValues]:
    """Every direction's values in whole steps; of several magnifications the best for all."""
    holds = curve.holds
    step = holds.step(curve.output.rotation)
    if curve.lever is not None and step:
        step /= curve.reach
    increment = holds.increment
    best: list[QuantisedValues] = []
    worst = np.inf
    for magnification in (1,) if increment is None else increment.magnifications:
        found = [
            quantise(
                w,
                nodes,
                step * magnification,
                value_range=holds.value_range,
                increment_limit=None if increment is None else increment.limit,
                zero=zero if k == 0 else None,
            )
            for k, w in enumerate(wanted)
        ]
        off = max(float(np.abs(f.values - w).max()) for f, w in zip(found, wanted, strict=True))
        if off < worst - 1e-12:
            best, worst = found, off
        if not any(f.limited for f in found):
            break  # greater steps could only be coarser
    return best
