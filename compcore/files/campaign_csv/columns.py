"""The header line of a campaign file: what each column is."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.sentences import said

NAMES = ("setup", "kind", "base", "base2", "tool", "gauge")
"""Columns that hold names; all others hold numbers."""
TOOL = ("tool_x", "tool_y", "tool_z")
UNIT_VECTOR = ("ux", "uy", "uz")
RESERVED = frozenset(("time", "value", "sd", "gauge_sd", *NAMES, *TOOL, *UNIT_VECTOR))
"""Column names with a meaning of their own: no signal may be called so."""

_MEANING = {
    "time": said("seconds since the campaign's start"),
    "setup": said("the name of one placing of the instrument"),
    "kind": said("displacement, rotation, distance or base_distance"),
    "value": said("error = actual − indicated, µm or µrad; distances mm"),
    "ux": said("the measured component's unit vector"),
    "uy": said("the measured component's unit vector"),
    "uz": said("the measured component's unit vector"),
    "base": said("the base point's name"),
    "base2": said("the second base point's name"),
    "gauge_sd": said("the standard uncertainty of the gauge's calibration in the row's value"),
}
AXIS = re.compile(r"[XYZUVWRABC][0-9]?")
"""What a column of positions may be called."""


@dataclass(frozen=True)
class Columns:
    """The columns of one file, by what they hold; each name is also the header's text.

    Attributes
    ----------
    header
        All columns in the file's order.
    positions, directions
        Axis → column.
    spindle
        Column of the spindle's angle, or None.
    signals
        The remaining columns.
    line
        The header's line number.
    """

    header: tuple[str, ...]
    positions: dict[str, str]
    directions: dict[str, str]
    spindle: str | None
    signals: tuple[str, ...]
    file: str
    line: int
    _index: dict[str, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_index", {name: i for i, name in enumerate(self.header)})

    def __contains__(self, name: str) -> bool:
        return name in self._index

    def index(self, name: str) -> int:
        """The place of a column, from 0."""
        return self._index[name]

    @property
    def numbers(self) -> tuple[str, ...]:
        """The columns that hold numbers, in the file's order."""
        return tuple(name for name in self.header if name not in NAMES)

    def missing(self, name: str, why: str = "") -> InputError:
        """The error for a column that is not there; `why` says what needs it."""
        return InputError(
            said("a column is missing: {why}", why=why) if why else "a column is missing",
            file=self.file,
            line=self.line,
            field=name,
            found=", ".join(self.header),
            expected=said("a column {name} ({what})", name=repr(name), what=_MEANING[name]),
        )

    def missing_axis(self, axis: str) -> InputError:
        """The error for an axis whose positions are not there."""
        unit = said("degrees") if is_rotary(axis) else "mm"
        return InputError(
            "a column is missing",
            file=self.file,
            line=self.line,
            field=axis,
            found=", ".join(self.header),
            expected=said(
                "a column {name} (indicated position of axis {axis}, {unit})",
                name=repr(axis),
                axis=axis,
                unit=unit,
            ),
        )


def read_columns(header: Sequence[str], machine: Machine, file: str, line: int) -> Columns:
    """Give every column of a campaign its meaning on a machine.

    Raises
    ------
    InputError
        As `name_columns`; and when a column is missing.
    """
    columns = name_columns(header, machine, file, line)
    for name in ("setup", "kind", "value"):
        if name not in columns:
            raise columns.missing(name)
    for axis in machine.structure.axes:
        if axis not in columns.positions:
            raise columns.missing_axis(axis)
    return columns


def name_columns(header: Sequence[str], machine: Machine, file: str, line: int) -> Columns:
    """Give every column its meaning on a machine, whichever there are.

    Raises
    ------
    InputError
        A repeated or nameless column, or one of an axis that the machine lacks.
    """
    names = tuple(name.strip() for name in header)
    if len(names) == 1 and (other := next((c for c in ";\t|" if c in names[0]), None)):
        raise InputError(
            "the columns are not separated by commas",
            file=file,
            line=line,
            found=other,
            expected="',' between columns and '.' in numbers",
        )
    for i, name in enumerate(names):
        if not name:
            raise InputError(
                said("column {number} has no name", number=i + 1),
                file=file,
                line=line,
                expected="a name per column",
            )
        if name in names[:i]:
            raise InputError(
                "the same column twice",
                file=file,
                line=line,
                field=name,
                found=f"columns {names.index(name) + 1} and {i + 1}",
                expected="every name once",
            )
    return _sorted(names, machine, file, line)


def _sorted(names: tuple[str, ...], machine: Machine, file: str, line: int) -> Columns:
    positions: dict[str, str] = {}
    directions: dict[str, str] = {}
    spindle: str | None = None
    signals: list[str] = []
    turning = machine.structure.spindle
    for name in names:
        axis = name.removesuffix("_dir")
        if name in RESERVED:
            continue
        if name in machine.axes:
            positions[name] = name
        elif axis in machine.axes and axis != name:
            directions[axis] = name
        elif turning is not None and name in (turning, f"({turning})"):
            if spindle is not None:
                raise InputError(
                    "the spindle's angle stands in two columns",
                    file=file,
                    line=line,
                    field=name,
                    found=f"{spindle} and {name}",
                    expected="one of the two",
                )
            spindle = name
        elif AXIS.fullmatch(axis) and name not in machine.signals:
            raise InputError(
                "the machine has no such axis",
                file=file,
                line=line,
                field=name,
                found=axis,
                expected=said("one of {names}", names=", ".join(machine.structure.axes)),
            )
        else:
            signals.append(name)
    return Columns(names, positions, directions, spindle, tuple(signals), file, line)
