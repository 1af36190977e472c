"""The working volume for which tables are optimised, and points spread over it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Machine
from abbe.compcore.tables.table import unit_of_position

F64 = NDArray[np.float64]

_LATTICES = (
    (7, 2),
    (13, 6),
    (31, 9),
    (61, 16),
    (149, 55),
    (233, 71),
    (613, 267),
    (997, 440),
    (2591, 448),
)
"""Numbers of points and the generators of Korobov lattices, good in up to six dimensions at once.

Found by trying all generators for the least product of the figures of merit P2 of dimensions two to
six; no two axes' coordinates are equal or mirrored (from 13 points on; with 7 up to three axes).
"""


@dataclass(frozen=True)
class Volume:
    """A working volume: the ranges of all axes, mm (rotary: rad)."""

    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, machine: Machine, stated: Mapping[str, tuple[float, float]] | None = None
    ) -> Volume:
        """The volume of a machine: its travels, or stated ranges (mm; rotary: rad).

        Raises
        ------
        InputError
            When a range names an axis that the machine lacks, is empty, or leaves the travel.
        """
        stated = stated or {}
        ranges = {}
        for name in stated:
            machine.axis(name, "volume")
        for name, axis in machine.axes.items():
            low, high = stated.get(name, axis.travel)
            slack = 1e-9 * (1.0 + abs(high) + abs(low))
            unit, factor = unit_of_position(name)
            if not low < high or low < axis.travel[0] - slack or high > axis.travel[1] + slack:
                ends = ", ".join(f"{end * factor:g}" for end in axis.travel)
                raise InputError(
                    "not a range inside the axis's travel",
                    field=f"volume {name}",
                    found=f"{low * factor:g},{high * factor:g}",
                    expected=f"low,high with low < high inside {ends} {unit}",
                )
            ranges[name] = (low, high)
        return cls(ranges)

    def middle(self, axis: str) -> float:
        """The middle of a range, mm or rad."""
        low, high = self.ranges[axis]
        return 0.5 * (low + high)

    def half(self, axis: str) -> float:
        """Half the length of a range, mm or rad."""
        low, high = self.ranges[axis]
        return 0.5 * (high - low)

    def inside(self, axis: str, positions: F64) -> NDArray[np.bool_]:
        """Which positions of an axis are in its range, (n,)."""
        low, high = self.ranges[axis]
        return (positions >= low) & (positions <= high)

    def spread(self, axes: Sequence[str], count: int) -> dict[str, F64]:
        """At least `count` points over the ranges of some axes, each (n,), mm or rad.

        A rank-1 lattice, shifted so that its points, seen along any one axis, stand at n
        equidistant positions symmetric about the middle: the mean of anything linear is exact.
        (Sloan and Joe, Lattice Methods for Multiple Integration, 1994.) At most 2591 points.
        """
        n, step = next((lattice for lattice in _LATTICES if lattice[0] >= count), _LATTICES[-1])
        at = np.arange(n)
        found = {}
        for k, axis in enumerate(axes):
            unit = (at * pow(step, k, n) % n + 0.5) / n
            low, high = self.ranges[axis]
            found[axis] = low + unit * (high - low)
        return found
