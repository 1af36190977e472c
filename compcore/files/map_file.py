"""The text layout of a CMM's compensation map: read, and written back.

Per axis a heading (``X Axis``), a header (``Position Lx Ly Lz Rx Ry Rz``) and rows of seven
numbers, separated by tabs or blanks; blank lines anywhere. Positions and linear errors in mm,
angular errors in mm/m. The rows of an axis run up or down.
"""

from __future__ import annotations

import re
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.files.text.numbers import checked_number
from abbe.compcore.machine.plausible import DISPLACEMENT, ROTATION, TRAVEL, Range
from abbe.compcore.maps.table import COLUMNS, AxisTable, CompensationMap, Row

HEADER = ("Position", *COLUMNS)
_HEADING = re.compile(r"\s*(\S+)\s+Axis\s*", re.IGNORECASE)
_AXIS = re.compile(r"[XYZUVWR][0-9]?")
_PER_RAD = 1e-3
_ALLOWED = {
    "P": TRAVEL,
    "L": Range(1e-3 * DISPLACEMENT.low, 1e-3 * DISPLACEMENT.high, "mm"),
    "R": Range(1e-3 * ROTATION.low, 1e-3 * ROTATION.high, "mm/m"),
}
"""First letter of a column → what its numbers can be."""
_UNITS = ("mm", "mm", "mm", "mm", "mm/m", "mm/m", "mm/m")


def load_map(path: str | Path) -> CompensationMap:
    """Read a compensation map.

    Raises
    ------
    InputError
        Naming file, line, column, what was found and what was expected.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError("no such file", file=path) from None
    except IsADirectoryError:
        raise InputError("is a folder, not a file", file=path) from None
    except UnicodeDecodeError as error:
        raise InputError(f"not UTF-8 text (byte {error.start})", file=path) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from None
    return parse_map(text, str(path))


def parse_map(text: str, file: str | None = None) -> CompensationMap:
    """A compensation map from its text; raises as `load_map`."""
    reader = _MapReader(file)
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip():
            reader.take(number, line)
    return reader.finish(text.count("\n") + 1)


class _MapReader:
    def __init__(self, file: str | None) -> None:
        self._file = file
        self._tables: dict[str, AxisTable] = {}
        self._axis: str | None = None
        self._heading = 0
        self._header_seen = False
        self._positions: list[float] = []
        self._rows: list[Row] = []

    def take(self, line: int, text: str) -> None:
        """One line that is not blank."""
        if heading := _HEADING.fullmatch(text):
            self._close()
            self._open(line, heading[1])
        elif self._axis is None:
            raise self._error("no axis yet", line, text.strip(), "a heading such as 'X Axis'")
        elif not self._header_seen:
            if [name.lower() for name in text.split()] != [name.lower() for name in HEADER]:
                raise self._error("not the header", line, text.strip(), " ".join(HEADER))
            self._header_seen = True
        else:
            self._row(line, text)

    def finish(self, last: int) -> CompensationMap:
        """The map, when all lines were taken."""
        self._close()
        if not self._tables:
            raise self._error("no axis in this file", last, None, "a heading such as 'X Axis'")
        return CompensationMap(self._tables, self._file)

    def _open(self, line: int, name: str) -> None:
        axis = name.upper()
        if not _AXIS.fullmatch(axis):
            raise self._error("not the name of a linear axis", line, name, "X, Y, Z, U, V or W")
        if axis in self._tables:
            first = self._tables[axis].line
            raise self._error(
                f"a second table for axis {axis}", line, name, f"one table; the first is on {first}"
            )
        self._axis, self._heading, self._header_seen = axis, line, False
        self._positions, self._rows = [], []

    def _row(self, line: int, text: str) -> None:
        fields = text.split()
        if len(fields) != len(HEADER):
            raise self._error(
                "wrong number of columns",
                line,
                f"{len(fields)} in {text.strip()!r}",
                f"{len(HEADER)}: " + " ".join(HEADER),
            )
        position, *values = (
            checked_number(
                field,
                file=self._file,
                line=line,
                field=name,
                expected=f"a number in {unit}",
                allowed=_ALLOWED[name[0]],
            )
            for name, unit, field in zip(HEADER, _UNITS, fields, strict=True)
        )
        before = self._positions
        if before and position == before[-1]:
            raise self._error("the same position twice", line, fields[0], "every position once")
        if len(before) >= 2 and (position > before[-1]) != (before[-1] > before[-2]):
            rising = before[-1] > before[-2]
            raise self._error(
                f"positions {'rise' if rising else 'fall'} and then turn round",
                line,
                fields[0],
                f"a position {'above' if rising else 'below'} {before[-1]:g} mm",
            )
        lx, ly, lz, rx, ry, rz = values
        before.append(position)
        self._rows.append((lx, ly, lz, rx * _PER_RAD, ry * _PER_RAD, rz * _PER_RAD))

    def _close(self) -> None:
        if self._axis is None:
            return
        if len(self._rows) < 2:
            raise self._error(
                f"the table of axis {self._axis} is too short",
                self._heading,
                f"{len(self._rows)} rows",
                "at least two rows",
            )
        self._tables[self._axis] = AxisTable(
            self._axis, tuple(self._positions), tuple(self._rows), self._heading
        )

    def _error(self, problem: str, line: int, found: str | None, expected: str) -> InputError:
        return InputError(problem, file=self._file, line=line, found=found, expected=expected)


def format_map(compensation: CompensationMap) -> str:
    """The text of a map: four decimals, more where a number has them."""
    parts = []
    for table in compensation.tables.values():
        rows = [
            [_text(position, 1.0)]
            + [_text(v, 1.0) for v in row[:3]]
            + [_text(v, _PER_RAD) for v in row[3:]]
            for position, row in zip(table.positions, table.values, strict=True)
        ]
        lines = [f"{table.axis} Axis", "", "\t".join(HEADER), *("\t".join(row) for row in rows)]
        parts.append("\n".join(lines) + "\n\n")
    return "".join(parts)


def _text(value: float, unit: float) -> str:
    """A number in the file's unit that reads back as the same value."""
    for decimals in (4, 5, 6, 7, 8, 9, 12):
        text = f"{value / unit:.{decimals}f}"
        if float(text) * unit == value:
            return text
    return repr(value / unit)
