"""Points at which a controller's correction was read on and off: the file.

::

    # format = "abbe-points/1"
    # unit = "um"                    of dX, dY, dZ: um or mm
    # positions = "off"              X, Y, Z were read with the correction off (default) or on
    X,Y,Z,tool_x,tool_y,tool_z,dX,dY,dZ
    200,600,-150,0,0,-80,46.9,187.5,79.2

``dX`` = reading with the correction on minus reading with it off, machine standing still. Or both
readings, in mm, as the display shows them: ``X_off,Y_off,Z_off,X_on,Y_on,Z_on``. Tool offsets (mm)
and signals are optional.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, ValidationError

from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_csv.head import plain_line
from abbe.compcore.files.campaign_csv.lines import LineSource, csv_cells
from abbe.compcore.files.text.numbers import checked_number
from abbe.compcore.files.text.toml_source import TomlSource
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.machine import Machine, OfMachine, machine_of
from abbe.compcore.machine.plausible import DISPLACEMENT, TOOL, TRAVEL, Range, signal_range
from abbe.compcore.maps.conventions.switched import SwitchedPoints

F64 = NDArray[np.float64]

_DIFFERENCES = ("dX", "dY", "dZ")
_TOOL = ("tool_x", "tool_y", "tool_z")
_ON = ("X_on", "Y_on", "Z_on")
_OFF = ("X_off", "Y_off", "Z_off")
_POSITIONS = ("X", "Y", "Z")
_FACTORS = {"um": 1e-3, "µm": 1e-3, "mm": 1.0}
_MOST_DECIMALS = 7
"""More decimals than a display has: the numbers were computed, not read off."""


class _PointsHead(BaseModel):
    model_config = ConfigDict(extra="allow", frozen=True)
    format: Literal["abbe-points/1"] = "abbe-points/1"
    unit: Literal["um", "µm", "mm"] | None = None
    positions: Literal["off", "on"] = "off"


def read_switched(path: str | Path, machine: Machine | OfMachine) -> SwitchedPoints:
    """Read a file of points.

    Raises
    ------
    InputError
        Naming file, line, column, what was found and what was expected.
    """
    machine = machine_of(machine)
    with LineSource(path) as source:
        numbered = [
            (first + i, line) for first, lines in source.chunks() for i, line in enumerate(lines)
        ]
    top: list[str] = []
    for _, line in numbered:
        if (plain := plain_line(line)) is None:
            break
        top.append(plain)
    return _PointTable(str(path), top, numbered[len(top) :], machine).points()


class _PointTable:
    def __init__(
        self, file: str, top: list[str], rows: list[tuple[int, str]], machine: Machine
    ) -> None:
        self._file, self._machine = file, machine
        toml = TomlSource("\n".join(top), file)
        try:
            self._head = _PointsHead.model_validate(toml.data)
        except ValidationError as error:
            raise toml.invalid(error) from None
        if not rows:
            raise InputError(
                "the header is missing",
                file=file,
                line=len(top) + 1,
                expected="X,Y,Z,dX,dY,dZ or X_off,Y_off,Z_off,X_on,Y_on,Z_on",
            )
        self._line, header = rows[0]
        self._names = [
            name.strip() for name in csv_cells(header, file, self._line, "a header line")
        ]
        self._check_header()
        self._cells = list(self._rows(rows[1:]))
        if not self._cells:
            raise InputError("no points", file=file, line=self._line, expected="a row a point")

    def points(self) -> SwitchedPoints:
        """What the table says, in mm."""
        both = self._both
        if both:
            off, on = self._columns(_OFF), self._columns(_ON)
            factor = 1.0
        else:
            factor = _FACTORS[self._head.unit or "mm"]
            difference = self._columns(_DIFFERENCES) * factor
            read = self._columns(_POSITIONS)
            off = read - difference if self._head.positions == "on" else read
            on = off + difference
        step = 10.0 ** -self._decimals(_ON if both else _DIFFERENCES) * factor
        rounded = step > 10.0**-_MOST_DECIMALS
        sigma = step / math.sqrt(6.0 if both else 12.0) if rounded else 0.0
        n = len(self._cells)
        tool = self._columns(_TOOL) if _TOOL[0] in self._names else np.zeros((n, 3))
        signals = {
            name: self._columns((name,))[:, 0]
            for name in self._names
            if name in self._machine.signals
        }
        positions = {a: off[:, k] for k, a in enumerate("XYZ")}
        positions |= {a: self._columns((a,))[:, 0] for a in self._others}
        conditions = Conditions(positions, tool=tool, signals=signals)
        return SwitchedPoints(conditions, on - off, sigma, both)

    def _check_header(self) -> None:
        names = self._names
        for name in names:
            if names.count(name) > 1:
                raise self._error("the same column twice", name, expected="every name once")
        self._others = [a for a in self._machine.structure.linear if a not in _POSITIONS]
        known = {
            *self._others,
            *_POSITIONS,
            *_DIFFERENCES,
            *_ON,
            *_OFF,
            *_TOOL,
            *self._machine.signals,
        }
        for name in names:
            if name not in known:
                raise self._error(
                    "unknown column",
                    name,
                    expected="X, Y, Z, dX, dY, dZ, or X_off … X_on …; tool_x, tool_y, tool_z; "
                    "or a signal of the model",
                )
        self._both = any(name in names for name in (*_ON, *_OFF))
        needed = (*_OFF, *_ON) if self._both else (*_POSITIONS, *_DIFFERENCES)
        tool = _TOOL if any(name in names for name in _TOOL) else ()
        for name in (*needed, *self._others, *tool):
            if name not in names:
                raise self._error("a column is missing", name, found=", ".join(names))
        if self._both and any(name in names for name in _DIFFERENCES):
            raise self._error(
                "differences and readings", "dX", expected="either dX, dY, dZ or X_on … X_off …"
            )
        if not self._both and self._head.unit is None:
            raise InputError(
                "the unit of dX, dY, dZ is not stated",
                file=self._file,
                line=1,
                field="unit",
                expected='a line # unit = "um" (or "mm") above the header',
            )

    def _error(
        self, problem: str, field: str, *, found: str | None = None, expected: str | None = None
    ) -> InputError:
        return InputError(
            problem, file=self._file, line=self._line, field=field, found=found, expected=expected
        )

    def _rows(self, rows: list[tuple[int, str]]) -> Iterator[tuple[int, list[str]]]:
        for line, text in rows:
            if not text.strip():
                continue
            cells = [cell.strip() for cell in csv_cells(text, self._file, line, "a row of CSV")]
            if len(cells) != len(self._names):
                raise InputError(
                    f"too {'few' if len(cells) < len(self._names) else 'many'} fields",
                    file=self._file,
                    line=line,
                    found=len(cells),
                    expected=f"{len(self._names)}, as the header has",
                )
            yield line, cells

    def _columns(self, names: tuple[str, ...]) -> F64:
        places = [self._names.index(name) for name in names]
        return np.array(
            [
                [
                    checked_number(
                        cells[at],
                        file=self._file,
                        line=line,
                        field=name,
                        allowed=self._range(name),
                    )
                    for name, at in zip(names, places, strict=True)
                ]
                for line, cells in self._cells
            ]
        )

    def _range(self, name: str) -> Range:
        if name in _DIFFERENCES:
            most = 1e-3 * DISPLACEMENT.high / _FACTORS[self._head.unit or "mm"]
            return Range(-most, most, self._head.unit or "mm")
        if name in _TOOL:
            return TOOL
        if name in self._machine.signals:
            return signal_range(self._machine.signals[name])
        return TRAVEL

    def _decimals(self, names: tuple[str, ...]) -> int:
        """The most decimals of any cell: what the display shows, trailing zeros or not."""
        places = [self._names.index(name) for name in names]
        texts = [cells[at] for _, cells in self._cells for at in places]
        if any("e" in text.lower() for text in texts):
            return 99
        return max(len(text.partition(".")[2]) for text in texts)
