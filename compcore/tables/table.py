"""Compensation tables: nodes, values, sign; linear between nodes, end values held."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.error_motion import FUNCTIONAL_POINT, Component, ErrorMotion
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.multilinear import interpolate

F64 = NDArray[np.float64]


class Sign(StrEnum):
    """Sign of a table's values (ISO/TR 16907, 3.14): error, or compensation = −error."""

    ERROR = "error"
    """actual − indicated"""
    COMPENSATION = "compensation"
    """−error: what is to be added to a command"""

    @property
    def factor(self) -> float:
        """The factor from an error to a value of this sign: 1 or −1."""
        return 1.0 if self is Sign.ERROR else -1.0


def move(axis: str) -> ErrorMotion:
    """The output of a table that moves X, Y or Z (or turns A, B, C) at the functional point."""
    component: Component = axis  # type: ignore[assignment]
    return ErrorMotion(FUNCTIONAL_POINT, component)


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """A compensation table: one error motion, piecewise linear over one to three axes' positions.

    Attributes
    ----------
    output
        What the number is. At `FUNCTIONAL_POINT`: a move of the axis X, Y or Z itself (or, A B C, a
        turn of the functional orientation). At an axis: that axis's error motion, which the
        controller carries to the functional point through its own levers.
    inputs
        Axes whose positions are looked up, one for each dimension.
    nodes
        Positions, strictly increasing, one array for each input, mm (rotary: rad).
    forward
        Values on the way up of ``inputs[0]``, mm or rad, shape (len(nodes[0]), …).
    backward
        Values on its way down; None: the same.
    sign
        Whether the values are errors or compensations.
    lever
        (axis, origin): the number is multiplied by that axis's position minus the origin (mm), its
        unit is then that of `output` per mm.
    """

    output: ErrorMotion
    inputs: tuple[str, ...]
    nodes: tuple[F64, ...]
    forward: F64
    backward: F64 | None = None
    sign: Sign = Sign.ERROR
    lever: tuple[str, float] | None = None

    def __post_init__(self) -> None:
        shape = tuple(len(n) for n in self.nodes)
        if len(self.inputs) != len(self.nodes) or self.forward.shape != shape:
            raise ValueError(f"{self.name}: values {self.forward.shape} on nodes {shape}")
        if self.backward is not None and self.backward.shape != shape:
            raise ValueError(f"{self.name}: backward values {self.backward.shape} on nodes {shape}")
        for axis, nodes in zip(self.inputs, self.nodes, strict=True):
            if not len(nodes) or not (np.diff(nodes) > 0.0).all():
                raise ValueError(f"{self.name}: nodes of {axis} do not increase")

    @property
    def name(self) -> str:
        """ISO 230-1 name: E_YX for a Y error that depends on X, E_X(X,Y) where on both.

        >>> import numpy as np
        >>> Table(move("Y"), ("X",), (np.zeros(1),), np.zeros(1)).name
        'E_YX'
        """
        component, place = self.output.component, self.output.place
        inside = ",".join(self.inputs)
        if place != FUNCTIONAL_POINT:
            text = f"E_{component}{place}"
            return text if self.inputs == (place,) else f"{text}({inside})"
        text = f"E_{component}{inside}" if len(self.inputs) == 1 else f"E_{component}({inside})"
        return text if self.lever is None else f"{text}·{self.lever[0]}"

    @property
    def direct(self) -> bool:
        """Whether the table moves an axis itself, without levers."""
        return self.output.place == FUNCTIONAL_POINT

    @property
    def directional(self) -> bool:
        """Whether the values of the two approach directions differ."""
        return self.backward is not None

    @property
    def downward(self) -> F64:
        """The values for negative approach, whether they differ or not."""
        return self.forward if self.backward is None else self.backward

    def as_sign(self, sign: Sign) -> Table:
        """The same table as errors, or as compensations."""
        if sign is self.sign:
            return self
        return replace(self.scaled(-1.0), sign=sign)

    def scaled(self, factor: float) -> Table:
        """Every value multiplied by a factor."""
        backward = None if self.backward is None else self.backward * factor
        return replace(self, forward=self.forward * factor, backward=backward)

    def at(self, *positions: F64, upward: bool = True) -> F64:
        """Values at positions (n,) of each input, in the table's sign; the lever is not applied."""
        values = self.forward if upward else self.downward
        return interpolate(self.nodes, values, positions)

    def value(self, conditions: Conditions) -> F64:
        """The error that the table compensates at n rows, mm or rad, lever applied.

        Where the direction is not known, the mean of the two.
        """
        positions = [conditions.position(axis) for axis in self.inputs]
        values = self.at(*positions)
        if self.backward is not None:
            down = self.at(*positions, upward=False)
            direction = conditions.direction(self.inputs[0])
            weight = 0.5 * (1.0 + np.sign(direction))
            values = weight * values + (1.0 - weight) * down
        if self.lever is not None:
            axis, origin = self.lever
            values = values * (conditions.position(axis) - origin)
        return values * self.sign.factor

    def reach(self, travel: tuple[float, float]) -> float:
        """The largest factor of the lever, its axis within a travel, mm; 1 without lever."""
        return 1.0 if self.lever is None else max(abs(end - self.lever[1]) for end in travel)

    def on(self, *nodes: F64) -> Table:
        """The table at other nodes; exact where they include the present ones."""
        mesh = np.meshgrid(*nodes, indexing="ij")
        flat = [m.reshape(-1) for m in mesh]
        shape = mesh[0].shape
        backward = None
        if self.backward is not None:
            backward = self.at(*flat, upward=False).reshape(shape)
        return replace(
            self, nodes=tuple(nodes), forward=self.at(*flat).reshape(shape), backward=backward
        )

    def plus(self, other: Table) -> Table:
        """The sum of two tables of the same error motion, in this one's sign, on the nodes of both.

        Raises
        ------
        ValueError
            When they are not tables of the same number.
        """
        if not self.same_number(other):
            raise ValueError(f"{self.name} and {other.name} cannot be added")
        both = zip(self.nodes, other.nodes, strict=True)
        union = [np.union1d(a, b) for a, b in both]
        mine, theirs = self.on(*union), other.as_sign(self.sign).on(*union)
        backward = None
        if mine.directional or theirs.directional:
            backward = mine.downward + theirs.downward
        return replace(mine, forward=mine.forward + theirs.forward, backward=backward)

    def same_number(self, other: Table) -> bool:
        """Whether two tables are of the same error motion over the same axes."""
        return (self.output, self.inputs, self.lever) == (other.output, other.inputs, other.lever)

    def difference(self, other: Table) -> float:
        """Largest difference of two tables of the same error motion, anywhere, mm or rad."""
        change = self.plus(other.as_sign(self.sign).scaled(-1.0))
        return float(max(np.abs(change.forward).max(), np.abs(change.downward).max()))

    def largest(self) -> float:
        """The largest value, mm or rad."""
        return float(max(np.abs(self.forward).max(), np.abs(self.downward).max()))


def tables_of(tables: Iterable[Table], axis: str) -> tuple[Table, ...]:
    """The tables whose first input is an axis, in order."""
    return tuple(t for t in tables if t.inputs[0] == axis)


def unit_of_position(axis: str) -> tuple[str, float]:
    """Unit in which files and screens give an axis's positions, and the factor to it.

    >>> unit_of_position("X")
    ('mm', 1.0)
    """
    return ("deg", 180.0 / np.pi) if is_rotary(axis) else ("mm", 1.0)


def superposed(new: Iterable[Table], present: Iterable[Table]) -> tuple[Table, ...]:
    """New tables added to those that a controller already holds (ISO/TR 16907, 10.5).

    Tables of a number that only one of the two holds are taken as they are, as errors.
    """
    total = [t.as_sign(Sign.ERROR) for t in present]
    for table in new:
        for i, held in enumerate(total):
            if held.same_number(table):
                total[i] = held.plus(table)
                break
        else:
            total.append(table.as_sign(Sign.ERROR))
    return tuple(total)
