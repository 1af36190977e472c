"""Conversion of a CMM's compensation map to a model that corrects as its controller does."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.effects import Angular, Effect, Positioning, Squareness, Straightness
from abbe.compcore.effects.base import AxisLetter
from abbe.compcore.errors import InputError, require_type
from abbe.compcore.machine.machine import Axis, Machine, own_component
from abbe.compcore.machine.structure import Structure
from abbe.compcore.maps.convention import Convention
from abbe.compcore.maps.squareness import with_squareness, with_squareness_as
from abbe.compcore.maps.table import AxisTable, CompensationMap
from abbe.compcore.model.model import Model, Term, Value

__all__ = ["AxisTable", "CompensationMap", "import_map"]

F64 = NDArray[np.float64]
_LETTERS: tuple[AxisLetter, ...] = ("X", "Y", "Z")


def import_map(
    compensation: CompensationMap,
    structure: Structure,
    convention: Convention | None = None,
    *,
    squareness: Mapping[tuple[str, str], float] | None = None,
    name: str = "",
) -> Model:
    """The model that corrects as a controller with this map and convention does.

    Every column becomes a ``table`` effect in Abbe's own signs; the rotation point and whether an
    axis's own travel is in its lever become properties of the axes; composition is exact. Nothing
    is approximated, except that numbers of `squareness` in gradient form are spread over a table's
    rows, which is exact too.

    Parameters
    ----------
    compensation
        The map; a table for every axis of the structure.
    structure
        The machine's structure, linear axes only.
    convention
        How the controller reads the map; Abbe's own where not given.
    squareness
        Pairs of axes in the structure's order → angle, rad: squareness that stands beside the map
        and not in it, in Abbe's sign. It is added as the convention's `stated` form: an angle
        becomes an effect ``squareness``, a gradient a slope of the second axis's straightness.
    name
        The machine's name.

    Raises
    ------
    InputError
        When map and structure do not name the same axes.
    """
    require_type(compensation, CompensationMap, "compensation")
    require_type(structure, Structure, "structure")
    convention = convention or Convention()
    machine = map_machine(compensation, structure, name)
    convention.check(machine)
    tables = in_abbes_signs(compensation, convention)
    tables = with_squareness_as(tables, convention.squareness, convention.on(machine))
    terms = []
    for pair, angle in (squareness or {}).items():
        if convention.stated == "gradient":
            Squareness(axes=pair).check(machine)
            tables = with_squareness(tables, machine, pair, angle, "gradient")
        else:
            terms.append(Term(Squareness(axes=pair), {"angle": Value(angle)}))
    columns = [term for axis in structure.axes for term in _terms(tables.tables[axis])]
    return Model(convention.on(machine), (*columns, *terms), composition="exact")


def map_machine(compensation: CompensationMap, structure: Structure, name: str = "") -> Machine:
    """The machine of a map in a structure; travels are the ranges of its tables, mm.

    Raises
    ------
    InputError
        When map and structure do not name the same axes, or the structure has rotary ones.
    """
    if structure.rotary:
        raise InputError(
            "a compensation map describes linear axes only",
            field="structure",
            found=str(structure),
            expected="a structure without " + ", ".join(structure.rotary),
        )
    for axis in structure.axes:
        if axis not in compensation.tables:
            raise InputError(
                f"the map has no table for axis {axis}",
                file=compensation.source,
                field=f"{axis} Axis",
                found=", ".join(compensation.tables),
                expected="a table for each of " + ", ".join(structure.axes),
            )
    for axis, table in compensation.tables.items():
        if axis not in structure.axes:
            raise InputError(
                f"axis {axis} of the map is not in the structure",
                file=compensation.source,
                line=table.line,
                field="structure",
                found=str(structure),
                expected="the axes " + ", ".join(compensation.tables),
            )
    axes = {a: Axis(a, compensation.tables[a].range) for a in structure.axes}
    return Machine(name, structure, axes)


def in_abbes_signs(compensation: CompensationMap, convention: Convention) -> CompensationMap:
    """The map with every column as error = actual − indicated, rotations right-handed."""
    return CompensationMap(
        {
            axis: table.scaled([convention.sign(axis, letter) for letter in "XYZABC"])
            for axis, table in compensation.tables.items()
        },
        compensation.source,
    )


def _terms(table: AxisTable) -> list[Term]:
    """The six columns of one axis as effects."""
    axis, rising = table.axis, table.rising()
    shape, positions = "table", rising.positions
    effects: list[Effect] = []
    for letter in _LETTERS:
        if letter == own_component(axis):
            effects.append(Positioning(axis=axis, shape=shape, positions=positions))
        else:
            effects.append(
                Straightness(axis=axis, direction=letter, shape=shape, positions=positions)
            )
    effects += [
        Angular(axis=axis, about=letter, shape=shape, positions=positions) for letter in _LETTERS
    ]
    columns = zip(*rising.values, strict=True)
    return [
        Term(effect, {f"v{i}": Value(v) for i, v in enumerate(column, start=1)})
        for effect, column in zip(effects, columns, strict=True)
    ]
