"""Axes in dialects: units of positions, numbers, what a table's value moves."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.error_motion import Component, ErrorMotion
from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.tables.table import Table, move

F64 = NDArray[np.float64]

DEGREE = math.pi / 180.0
"""rad"""


def position_unit(axis: str) -> float:
    """A millimetre, or for a rotary axis a degree, in mm or rad."""
    return DEGREE if is_rotary(axis) else 1.0


def axis_numbers(machine: Machine, given: Mapping[str, int], first: int = 1) -> dict[str, int]:
    """Axis → number: as given, or X, Y, Z and then the others as the structure lists them.

    >>> from abbe.compcore.machine.machine import Axis
    >>> from abbe.compcore.machine.structure import Structure
    >>> structure = Structure.parse("w C' b Y X Z t")
    >>> machine = Machine("", structure, {a: Axis(a, (0.0, 1.0)) for a in structure.axes})
    >>> axis_numbers(machine, {})
    {'X': 1, 'Y': 2, 'Z': 3, 'C': 4}
    """
    axes = machine.structure.axes
    if given:
        for axis in given:
            machine.axis(axis, "axes")
        return dict(given)
    order = [a for a in "XYZ" if a in axes] + [a for a in axes if a not in "XYZ"]
    return {axis: i for i, axis in enumerate(order, start=first)}


def moved_axis(table: Table) -> str:
    """The axis that a table of moves corrects."""
    return table.output.component if table.direct else table.output.place


def output_of(axis: str) -> ErrorMotion:
    """The output of a table that corrects an axis itself: a move, or its own turn."""
    component: Component = own_component(axis)  # type: ignore[assignment]
    return ErrorMotion(axis, component) if is_rotary(axis) else move(component)


def equidistant(start: float, step: float, count: int) -> F64:
    """Positions from a start at one distance, (count,).

    Raises
    ------
    InputError
        When they do not increase: no distance, or too small a one so far out.
    """
    found = np.asarray(start + step * np.arange(count), dtype=np.float64)
    if not (np.diff(found) > 0.0).all():
        raise InputError(
            "positions that do not increase", field="distance", found=f"{step:g} from {start:g}",
            expected="a distance above 0",
        )  # fmt: skip
    return found
