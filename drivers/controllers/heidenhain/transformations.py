"""Error motions in a TNC's kinematic chain: rows of it from the tool to the workpiece.

The chain begins at the tool (iTNC 530 HSCI Technical Manual p. 722): Trans moves or turns the
frame, MachAxis is where an axis moves all before it relative to all after it. Error motions stand
where Abbe's lever rule has them: beside the move of their axis, on the tool's side of it or on the
workpiece's, about the axis's line or rotation point.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from abbe.compcore.errors import InputError
from abbe.compcore.machine.error_motion import Component
from abbe.compcore.machine.machine import Machine, Vec3, nominal_direction
from abbe.drivers.controllers.text import fixed

_ENTRIES = 100
_COORDINATES = 50
_ORDER: tuple[Component, ...] = ("X", "Y", "Z", "A", "B", "C")


@dataclass(frozen=True, slots=True)
class Row:
    """One row of the chain.

    Attributes
    ----------
    key
        ``Trans``, ``MachAxis`` or ``MachBase``.
    axis
        Machine axis of a MachAxis; component of a Trans.
    coordinate
        Of a nominal Trans, mm.
    error_of
        The axis whose error motion a Trans is; None: nominal.
    """

    key: Literal["Trans", "MachAxis", "MachBase"]
    axis: str = ""
    coordinate: float | None = None
    error_of: str | None = None


def rows_from_tool(machine: Machine, used: Mapping[str, set[Component]]) -> list[Row]:
    """The chain of a machine with its error motions.

    Parameters
    ----------
    machine
        Axes along X, Y, Z or about them.
    used
        Axis → components that its table holds, beside its own.

    Raises
    ------
    InputError
        For an axis that lies askew, or more entries than the control takes.
    """
    structure = machine.structure
    rows = [r for a in reversed(structure.tool_side) for r in _axis_rows(machine, a, used)]
    rows.append(Row("MachBase"))
    rows += [r for a in reversed(structure.workpiece_side) for r in _axis_rows(machine, a, used)]
    _within_limits(rows)
    return rows


def _axis_rows(machine: Machine, name: str, used: Mapping[str, set[Component]]) -> list[Row]:
    """One axis's move with its error motions beside it."""
    axis = machine.axis(name)
    if not np.allclose(axis.direction, nominal_direction(name)):
        raise InputError(
            "an axis that lies askew has no row in the description of the kinematics",
            field=f"machine.axes.{name}.direction", found=list(axis.direction),
        )  # fmt: skip
    errors = [Row("Trans", c, error_of=name) for c in _ORDER if c in used.get(name, set())]
    move = Row("MachAxis", name)
    if axis.rotary:
        # components are seen from the stator, the side of the bed
        carried = name in machine.structure.workpiece_side
        rows = [*errors, move] if carried else [move, *errors]
        return [*_to(axis.location), *rows, *_back(axis.location)]
    if errors:
        errors = [*_to(axis.rotation_point), *errors, *_back(axis.rotation_point)]
    return [move, *errors] if machine.own_move_in_lever(name) else [*errors, move]


def _to(point: Vec3) -> list[Row]:
    return [Row("Trans", k, q) for k, q in zip("XYZ", point, strict=True) if q]


def _back(point: Vec3) -> list[Row]:
    return [Row("Trans", k, -q) for k, q in zip("XYZ", point, strict=True) if q]


def _within_limits(rows: list[Row]) -> None:
    entries = sum(r.key == "MachAxis" or r.error_of is not None for r in rows)
    coordinates = sum(r.coordinate is not None for r in rows)
    for found, most, what in (
        (entries, _ENTRIES, "MachAxis and COMPTAB"),
        (coordinates, _COORDINATES, "COORD"),
    ):
        if found > most:
            raise InputError(
                f"the control takes no more entries of {what}", found=found,
                expected=f"at most {most}",
            )  # fmt: skip


def written_rows(
    rows: list[Row], keys: Mapping[str, str], reference: Callable[[str, Component], str]
) -> dict[str, tuple[str, ...]]:
    """The columns DOC, KEY, AXIS, COORD and COMPTAB of a chain.

    Parameters
    ----------
    rows
        As `rows_from_tool` gives them.
    keys
        Axis → its key on the control.
    reference
        Names the column of an axis's error motion in COMPTAB.
    """
    table: list[tuple[str, str, str, str, str]] = []
    for row in rows:
        if row.error_of is not None:
            component: Component = row.axis  # type: ignore[assignment]
            doc = f"E{component}{row.error_of}"
            table.append((doc, row.key, component, "", reference(row.error_of, component)))
        else:
            axis = keys.get(row.axis, row.axis) if row.key == "MachAxis" else row.axis
            where = "" if row.coordinate is None else fixed(row.coordinate, 4)
            table.append(("", row.key, axis, where, ""))
    names = ("DOC", "KEY", "AXIS", "COORD", "COMPTAB")
    return {name: tuple(r[i] for r in table) for i, name in enumerate(names)}
