"""Heidenhain TNC: compensation-value tables (*.COM), their assignment (*.CMA), KinematicsComp."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator

from abbe.compcore.errors import InputError
from abbe.compcore.machine.error_motion import Component, ErrorMotion
from abbe.compcore.machine.machine import own_component
from abbe.compcore.tables.capability import Capability, Holds, Spacing
from abbe.compcore.tables.table import Table, tables_of
from abbe.drivers.controllers.axes import DEGREE, F64, moved_axis, output_of, position_unit
from abbe.drivers.controllers.base import (
    Cannot,
    Confidence,
    Controller,
    ControllerOptions,
    NamePerAxis,
    Trust,
)
from abbe.drivers.controllers.heidenhain.text import NcTable, nc_table, read_nc_table
from abbe.drivers.controllers.heidenhain.transformations import rows_from_tool, written_rows
from abbe.drivers.controllers.text import fixed, increasing, number

_POINTS = 256
_ASSIGNMENT = "config.cma"
_KINEMATICS = "kinematics.tab"
_POSITION_DECIMALS = 4
_COLUMNS: dict[str, Component] = {
    "C1": "X", "C2": "Y", "C3": "Z", "C4": "A", "C5": "B", "C6": "C",
}  # fmt: skip
"""KinematicsComp's columns of a table and the error motion that each holds."""


class HeidenhainTncOptions(ControllerOptions):
    """Options of `HeidenhainTnc`."""

    form: Literal["axes", "kinematics"] = "axes"
    """axes: each axis by its own and by other axes' positions; kinematics: KinematicsComp."""
    axes: NamePerAxis = Field(default_factory=dict)
    """Axis → its key in CfgAxes/axisList; none: its letter."""
    decimals: Annotated[int, Field(ge=3, le=6)] = 4
    """Decimals of values in mm."""
    angle_decimals: Annotated[int, Field(ge=3, le=8)] = 5
    """Decimals of values in degrees."""
    reference: str = "A..{column}"
    """How COMPTAB names a column; {axis} is the axis's key."""
    kinematics_sign: Literal["error", "compensation"] = "error"
    """Whether the columns C1 to C6 hold the error motions or their opposite."""

    @field_validator("reference")
    @classmethod
    def _names_the_column(cls, value: str) -> str:
        try:
            named = value.format(column="#column#", axis="X")
        except (KeyError, IndexError, ValueError):
            named = ""
        if "#column#" not in named or not named.isprintable() or " " in named:
            raise ValueError("must contain {column} and no blanks; {axis} may stand in it")
        return value


class HeidenhainTnc(Controller):
    """A table for each axis, with a column for every axis that is corrected by its position.

    AXISPOS is the position, in the column of the axis itself stands its value on the way up, in
    BACKLASH that on the way down, in another axis's column what moves that axis. config.cma names
    the table of each axis; its line with a * is active. With form=kinematics (option
    KinematicsComp, iTNC 530) the columns C1 to C6 hold the error motions, C4 to C6 in degrees, and
    the rows of kinematics.tab say where in the chain from the tool they act: the control then knows
    the levers.
    """

    name: ClassVar[str] = "heidenhain-tnc"
    title: ClassVar[str] = "Heidenhain TNC (COM and CMA tables; KinematicsComp on the iTNC 530)"
    sign: ClassVar[str] = (
        "error (actual − indicated), mm and degrees: positive where the travel is too long, as for "
        "the linear compensation; error motions by their ISO 230-1 names"
    )
    source: ClassVar[str] = (
        "MANUALplus 620 Technical Manual p. 715-718 (COM and CMA), iTNC 530 HSCI Technical Manual "
        "p. 670-686 (KinematicsComp) and 722 (rows), TNC 407 Technical Manual p. 151-156 (sign of "
        "the linear compensation, limits)"
    )
    trust: ClassVar[Trust] = Trust(
        Confidence.UNVERIFIED,
        Confidence.UNVERIFIED,
        Confidence.DOCUMENTED,
        "columns, files, their assignment and the kinematics rows are documented; not documented: "
        "the first and the last line of the text file and the widths of its columns (as other "
        "programs read TNC tables), how the iTNC 530's own tables state positions, what the A of "
        "A..C2 stands for, the sign of table values (taken from the linear compensation; of C1 to "
        "C6 from their ISO names, while the sign of COORD speaks for kinematics_sign="
        "compensation), that C4 to C6 are in degrees",
    )
    cannot: ClassVar[tuple[Cannot, ...]] = (
        Cannot(
            "Heidenhain TNC 407 to 430: text of COM and CMA files",
            "the manuals that were read say which numbers a table has (first position, a power of "
            "two as spacing, at most 256 values), not the lines of the file",
        ),
    )
    Options: ClassVar[type[ControllerOptions]] = HeidenhainTncOptions
    options: HeidenhainTncOptions

    @property
    def _kinematic(self) -> bool:
        return self.options.form == "kinematics"

    @property
    def capability(self) -> Capability:
        """L-POS in two directions and L-STR; L-VOL with KinematicsComp."""
        unit = 10.0**-_POSITION_DECIMALS
        axis = Holds(
            "axis",
            ("L-POS", "R-POS"),
            points=_POINTS,
            spacing=Spacing("equidistant", least=0.01, unit=unit),
            rotary_spacing=Spacing("equidistant", least=0.01 * DEGREE, unit=unit * DEGREE),
            directional=True,
            resolution=10.0**-self.options.decimals,
            rotary_resolution=10.0**-self.options.angle_decimals * DEGREE,
        )
        if self._kinematic:
            motions = replace(axis, form="motions", types=("L-VOL", "R-VOL"), directional=False)
            return Capability((motions,), lookup="command", shared_nodes=True, knows_tool=True)
        cross = replace(axis, form="cross", types=("L-STR", "L-SQU", "R-RAX"), directional=False)
        return Capability((axis, cross), lookup="command", shared_nodes=True)

    @property
    def _keys(self) -> dict[str, str]:
        """Axis → its key on the control."""
        return {a: self.options.axes.get(a, a) for a in self.machine.structure.axes}

    def _column(self, table: Table) -> str:
        """The column of a table's values."""
        (axis,) = table.inputs
        if not self._kinematic:
            return self._keys[moved_axis(table)]
        if table.output.component == own_component(axis):
            return self._keys[axis]
        return next(k for k, c in _COLUMNS.items() if c == table.output.component)

    def _turned(self, column: str) -> float:
        other = self.options.kinematics_sign == "compensation"
        return -1.0 if column in _COLUMNS and other else 1.0

    def _cells(self, values: F64, rotation: bool) -> tuple[str, ...]:
        decimals = self.options.angle_decimals if rotation else self.options.decimals
        return tuple(fixed(float(v) / (DEGREE if rotation else 1.0), decimals) for v in values)

    def _format(self, tables: Sequence[Table]) -> dict[str, str]:
        files: dict[str, str] = {}
        used: dict[str, set[Component]] = {}
        for axis in dict.fromkeys(t.inputs[0] for t in tables):
            mine = tables_of(tables, axis)
            nodes = mine[0].nodes[0] / position_unit(axis)
            columns = {"AXISPOS": tuple(fixed(float(q), _POSITION_DECIMALS) for q in nodes)}
            for table in mine:
                column, rotation = self._column(table), table.output.rotation
                turn = self._turned(column)
                if table.backward is not None:
                    columns["BACKLASH"] = self._cells(table.backward, rotation)
                columns[column] = self._cells(turn * table.forward, rotation)
                if column in _COLUMNS and np.any(table.forward):
                    used.setdefault(axis, set()).add(_COLUMNS[column])
            files[_file(self._keys[axis])] = nc_table(_file(self._keys[axis]), columns, unit=True)
        keys = [self._keys[a] for a in self.machine.structure.axes if _file(self._keys[a]) in files]
        line = {"ACTIVE": ("*",)} | {key: (_file(key),) for key in keys}
        files[_ASSIGNMENT] = nc_table(_ASSIGNMENT, line)
        if self._kinematic:
            rows = self._rows(used)
            files[_KINEMATICS] = nc_table(_KINEMATICS, rows)
        return files

    def _rows(self, used: Mapping[str, set[Component]]) -> dict[str, tuple[str, ...]]:
        columns = {c: k for k, c in _COLUMNS.items()}
        reference = self.options.reference
        return written_rows(
            rows_from_tool(self.machine, used), self._keys,
            lambda axis, c: reference.format(column=columns[c], axis=self._keys[axis]),
        )  # fmt: skip

    def _parse(self, files: Mapping[str, str]) -> Sequence[Table]:
        axes = {key: axis for axis, key in self._keys.items()}
        found: list[Table] = []
        named = self._active(files)
        for axis, file in named.items():
            found += self._tables(axis, axes, read_nc_table(file, files[file]))
        known = {_ASSIGNMENT, *named.values()} | ({_KINEMATICS} if self._kinematic else set())
        for file in files:
            if file not in known:
                raise InputError(
                    "a file that the active line does not name", file=file,
                    expected=", ".join(sorted(known)),
                )  # fmt: skip
        if self._kinematic:
            self._same_rows(found, files)
        return found

    def _active(self, files: Mapping[str, str]) -> dict[str, str]:
        """Axis → file of the active line of config.cma."""
        axes = {key: axis for axis, key in self._keys.items()}
        if _ASSIGNMENT not in files:
            return self._by_name(files)
        table = read_nc_table(_ASSIGNMENT, files[_ASSIGNMENT])
        active = [i for i, mark in enumerate(table.column("ACTIVE")) if mark == "*"]
        if len(active) != 1:
            raise InputError(
                "not one line is active", file=_ASSIGNMENT, field="ACTIVE", found=len(active),
                expected="a * in one line",
            )  # fmt: skip
        found = {}
        for key in table.names:
            file = table.column(key)[active[0]]
            if key in ("NR", "ACTIVE") or not file:
                continue
            if key not in axes:
                raise _no_axis(key, axes, _ASSIGNMENT, table.head_line)
            if file not in files:
                raise InputError(
                    "a table that is named is missing", file=_ASSIGNMENT,
                    line=table.lines[active[0]], found=file, expected=", ".join(files),
                )  # fmt: skip
            found[axes[key]] = file
        return found

    def _by_name(self, files: Mapping[str, str]) -> dict[str, str]:
        """Axis → file, without config.cma: by the names that Abbe gives them."""
        own = {_file(key): axis for axis, key in self._keys.items()}
        found = {own[file]: file for file in files if file in own}
        if not found:
            raise InputError(
                "the file that says which table is whose is missing", file=", ".join(files),
                expected=f"{_ASSIGNMENT}, or tables named {', '.join(own)}",
            )  # fmt: skip
        return found

    def _tables(self, axis: str, axes: Mapping[str, str], table: NcTable) -> list[Table]:
        """The tables over one axis's position."""
        if len(table.lines) > _POINTS:
            raise InputError(
                "more points than a table may have", file=table.file, found=len(table.lines),
                expected=f"at most {_POINTS}",
            )  # fmt: skip
        where = table.numbers("AXISPOS")
        nodes = increasing(list(where), table.file, table.head_line, "AXISPOS")
        steps = np.diff(nodes)
        if steps.size and np.ptp(steps) > 2.5 * 10.0**-_POSITION_DECIMALS:
            raise InputError(
                "points at different distances", file=table.file, field="AXISPOS",
                found=f"{steps.min():g} to {steps.max():g}", expected="one distance",
            )  # fmt: skip
        nodes = nodes * position_unit(axis)
        own = self._keys[axis]
        if "BACKLASH" in table.names and own not in table.names:
            raise InputError(
                "a way down without a way up", file=table.file, line=table.head_line,
                field="BACKLASH", expected=f"also the column {own}",
            )  # fmt: skip
        found = []
        for column in table.names:
            if column in ("NR", "AXISPOS", "BACKLASH"):
                continue
            output = self._output(axis, column, axes, table)
            scale = self._turned(column) * (DEGREE if output.rotation else 1.0)
            down = None
            if column == own and "BACKLASH" in table.names:
                down = scale * table.numbers("BACKLASH")
            found.append(Table(output, (axis,), (nodes,), scale * table.numbers(column), down))
        return found

    def _output(
        self, axis: str, column: str, axes: Mapping[str, str], table: NcTable
    ) -> ErrorMotion:
        if self._kinematic and column in _COLUMNS:
            return ErrorMotion(axis, _COLUMNS[column])
        if column not in axes or (self._kinematic and axes[column] != axis):
            raise _no_axis(column, axes, table.file, table.head_line)
        if self._kinematic:
            component: Component = own_component(axis)  # type: ignore[assignment]
            return ErrorMotion(axis, component)
        return output_of(axes[column])

    def _same_rows(self, tables: Sequence[Table], files: Mapping[str, str]) -> None:
        """Raise `InputError` where the kinematics rows are not those of the tables."""
        if _KINEMATICS not in files:
            raise InputError("the kinematics rows are missing", expected=_KINEMATICS)
        used: dict[str, set[Component]] = {}
        for table in tables:
            (axis,) = table.inputs
            if table.output.component != own_component(axis) and np.any(table.forward):
                used.setdefault(axis, set()).add(table.output.component)
        mine, found = self._rows(used), read_nc_table(_KINEMATICS, files[_KINEMATICS])
        for column in ("KEY", "AXIS", "COORD", "COMPTAB"):
            theirs = found.column(column)
            if column == "COORD":
                same = [_coordinate(c, found, i) for i, c in enumerate(theirs)] == [
                    float(c or "0") for c in mine[column]
                ]
            else:
                same = theirs == mine[column]
            if not same:
                at = next(
                    (i for i, (a, b) in enumerate(zip(theirs, mine[column], strict=False))
                     if a != b), min(len(theirs), len(mine[column])) - 1,
                )  # fmt: skip
                raise InputError(
                    "rows that do not put each error motion where this machine has it",
                    file=_KINEMATICS, line=found.lines[at] if found.lines else None, field=column,
                    found=", ".join(filter(None, theirs)),
                    expected=", ".join(filter(None, mine[column])),
                )  # fmt: skip

    def activation(self) -> tuple[str, ...]:
        """Copy, assign, activate, check."""
        kinematic = (
            "Add the rows of kinematics.tab to the description of the kinematics, each before or "
            "after its MachAxis as written: the rows without COMPTAB are those of the machine as "
            "it should be. At most 100 entries of MachAxis and COMPTAB together, 50 in COORD.",
            "Inverse rows after the axis are left out: all axes are in these tables "
            "(iTNC 530 HSCI Technical Manual p. 686).",
        )
        return (
            "Save the tables and the assignment that were active.",
            "Copy the COM files to the folder of the machine's tables (CfgOemPath/oemTable), "
            "config.cma to that of CfgTablePath/TABCMA.",
            *(kinematic if self._kinematic else ()),
            "In config.cma the line with * is active; it is chosen in the table or by the PLC, and "
            "nonlinear compensation must be switched on for each axis (MP730 on older controls).",
            "Positions count from the machine datum: reference the axes first.",
            "Check one point of each table with an indicator before cutting: the sign has not been "
            "tried. If the error doubles: invert=true"
            + (", or kinematics_sign=compensation for C1 to C6." if self._kinematic else "."),
        )


def _file(key: str) -> str:
    return f"{key.lower()}.com"


def _no_axis(key: str, axes: Mapping[str, str], file: str, line: int) -> InputError:
    return InputError(
        "a column of an axis that this table cannot have", file=file, line=line, found=key,
        expected="one of " + ", ".join(axes) + "; see the option axes",
    )  # fmt: skip


def _coordinate(cell: str, table: NcTable, row: int) -> float:
    return number(cell, table.file, table.lines[row], "COORD") if cell else 0.0
