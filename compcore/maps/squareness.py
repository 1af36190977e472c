"""Squareness in a compensation map: a constant of an angular column, or a gradient of straightness.

The squareness of two axes (in the structure's order, workpiece to tool) is the angle by which all
that stands behind the first axis's move is turned about the third direction ω. A map can hold it

* as an **angle**: a constant in the first axis's angular column about ω, or
* as a **gradient**: a slope in the second axis's straightness along the first, ``(ω×u₂)·u₁`` mm/mm
  per rad.

At the end of the ram the two move the functional point alike, to first order. With a probe or tool
offset t they do not: the angle turns it as well, by ``ω × t``, and turns the orientation; and an
angle acts through the levers from the rotation point, a gradient from the map's zero.
"""

from __future__ import annotations

from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.machine import Machine, own_component
from abbe.compcore.maps.table import COMPONENTS, AxisTable, CompensationMap

F64 = NDArray[np.float64]
Form = Literal["angle", "gradient"]


def square_pairs(machine: Machine) -> list[tuple[str, str]]:
    """Pairs of linear axes of different directions, each in the structure's order."""
    linear = machine.structure.linear
    return [(a, b) for a, b in combinations(linear, 2) if own_component(a) != own_component(b)]


def with_squareness(
    compensation: CompensationMap,
    machine: Machine,
    pair: tuple[str, str],
    angle: float,
    form: Form,
) -> CompensationMap:
    """The map with a squareness (rad) added to its columns, as angle or as gradient.

    Parameters
    ----------
    pair
        Two axes in the structure's order.
    angle
        Right-handed turn of all behind the first axis's move about the third direction, rad.
    """
    first, second = (compensation.tables[a] for a in pair)
    third, slope = third_direction(pair)
    if form == "gradient":
        return compensation.replaced(_sloped(second, own_component(pair[0]), slope * angle))
    column = COMPONENTS.index("ABC"["XYZ".index(third)])
    values = first.array()
    values[:, column] += angle
    turned = first.with_array(values)
    if machine.own_move_in_lever(pair[0]):
        # its own move is not to turn along: the angle is between the two moves
        turned = _sloped(turned, own_component(pair[1]), slope * angle)
    return compensation.replaced(turned)


def squareness_in(compensation: CompensationMap, pair: tuple[str, str], form: Form) -> float:
    """The squareness that a map's columns hold in one form, rad (`with_squareness`).

    Of an angular column the mean over its rows, of a straightness column the slope of its
    best-fit line: the parts that remain when a map is split into squareness and the rest.
    """
    first, second = (compensation.tables[a] for a in pair)
    third, slope = third_direction(pair)
    if form == "angle":
        column = COMPONENTS.index("ABC"["XYZ".index(third)])
        return float(first.array()[:, column].mean())
    column = COMPONENTS.index(own_component(pair[0]))
    x, y = np.asarray(second.positions), second.array()[:, column]
    x = x - x.mean()
    return float(x @ y / (x @ x)) / slope


def move_squareness(
    compensation: CompensationMap,
    machine: Machine,
    pair: tuple[str, str],
    to: Form,
    angle: float | None = None,
) -> CompensationMap:
    """The map with a squareness moved from one form to the other.

    Parameters
    ----------
    angle
        How much, rad; all that the columns of the other form hold (`squareness_in`) where not
        given. Moved there and back, a stated angle leaves the map as it was.
    """
    other: Form = "gradient" if to == "angle" else "angle"
    if angle is None:
        angle = squareness_in(compensation, pair, other)
    without = with_squareness(compensation, machine, pair, -angle, other)
    return with_squareness(without, machine, pair, angle, to)


def with_squareness_as(
    compensation: CompensationMap, form: Form | Literal["as written"], machine: Machine
) -> CompensationMap:
    """The map with every pair's squareness in one form; unchanged for ``as written``."""
    if form == "as written":
        return compensation
    other: Form = "gradient" if form == "angle" else "angle"
    for pair in square_pairs(machine):
        if angle := squareness_in(compensation, pair, other):
            compensation = move_squareness(compensation, machine, pair, form, angle)
    return compensation


def third_direction(pair: tuple[str, str]) -> tuple[str, float]:
    """The rotation axis of a pair's squareness and its sign: ω and ``(ω×u₂)·u₁``."""
    first, second = (own_component(a) for a in pair)
    (third,) = set("XYZ") - {first, second}
    u = dict(zip("XYZ", np.eye(3), strict=True))
    return third, float(np.cross(u[third], u[second]) @ u[first])


def _sloped(table: AxisTable, direction: str, slope: float) -> AxisTable:
    """A slope (mm/mm) from the map's zero added to one linear column."""
    values = table.array()
    values[:, COMPONENTS.index(direction)] += slope * np.asarray(table.positions)
    return table.with_array(values)
