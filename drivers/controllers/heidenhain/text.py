"""Text of Heidenhain's NC tables: a heading, columns of fixed width, [END]."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from abbe.compcore.errors import InputError
from abbe.drivers.controllers.axes import F64
from abbe.drivers.controllers.text import number

_BEGIN = re.compile(r"BEGIN (?P<name>[A-Za-z_0-9]+\.[A-Za-z0-9]{1,4})(?P<unit> MM| INCH)?\s*")
_END = "[END]"
_LEAST_WIDTH = 12


@dataclass(frozen=True, slots=True)
class NcTable:
    """A table as read.

    Attributes
    ----------
    file
        For messages.
    names
        Columns in order.
    cells
        Column → its cells, one for each row, without blanks around.
    head_line, lines
        Line numbers of the heading and of each row.
    """

    file: str
    names: tuple[str, ...]
    cells: Mapping[str, tuple[str, ...]]
    head_line: int
    lines: tuple[int, ...]

    def column(self, name: str) -> tuple[str, ...]:
        """The cells of a column.

        Raises
        ------
        InputError
            When there is no such column.
        """
        if name not in self.cells:
            raise InputError(
                "a column is missing", file=self.file, line=self.head_line, field=name,
                found=" ".join(self.names),
            )  # fmt: skip
        return self.cells[name]

    def numbers(self, name: str) -> F64:
        """The numbers of a column, (rows,); where no entry is, on the line between its neighbours.

        Raises
        ------
        InputError
            When a cell is not a number, or none has an entry.
        """
        cells = self.column(name)
        rows = [i for i, cell in enumerate(cells) if cell]
        if not rows:
            raise InputError(
                "a column without an entry", file=self.file, line=self.head_line, field=name
            )
        values = [number(cells[i], self.file, self.lines[i], name) for i in rows]
        return np.interp(np.arange(len(cells)), rows, values)


def nc_table(name: str, columns: Mapping[str, Sequence[str]], *, unit: bool = False) -> str:
    """The text of a table: a running number, then the columns; empty cells have no entry.

    Parameters
    ----------
    name
        Of the file.
    columns
        Name → cells, all of one length.
    unit
        Whether the heading says MM.
    """
    count = len(next(iter(columns.values())))
    all_columns = {"NR": [str(i) for i in range(count)], **columns}
    widths = {
        key: max(_LEAST_WIDTH if key != "NR" else 6, 2 + max(len(t) for t in (key, *cells)))
        for key, cells in all_columns.items()
    }
    lines = [f"BEGIN {name}{' MM' if unit else ''}"]
    lines.append("".join(f"{key:<{widths[key]}}" for key in all_columns).rstrip())
    for i in range(count):
        row = "".join(f"{cells[i]:<{widths[key]}}" for key, cells in all_columns.items())
        lines.append(row.rstrip())
    return "".join(f"{line}\n" for line in [*lines, _END])


def read_nc_table(file: str, text: str) -> NcTable:
    """A table from its text.

    Raises
    ------
    InputError
        With file and line, where the text is not one.
    """
    lines = [line.rstrip() for line in text.splitlines()]
    while lines and not lines[-1]:
        lines.pop()
    begin = _BEGIN.fullmatch(lines[0]) if lines else None
    if begin is None or lines[-1] != _END or len(lines) < 3:
        raise InputError(
            "not a whole table of a TNC", file=file, found=lines[0][:60] if lines else "nothing",
            expected=f"BEGIN name.COM …, columns, rows, {_END}",
        )  # fmt: skip
    if begin["unit"] == " INCH":
        raise InputError("not in mm", file=file, line=1, found=lines[0], expected="… MM")
    head = 1
    while head < len(lines) - 1 and lines[head].startswith("#"):
        head += 1  # a description of the columns, in some versions
    starts = [(m.start(), m.group()) for m in re.finditer(r"\S+", lines[head])]
    names = tuple(name for _, name in starts)
    if len(set(names)) != len(names) or not names or names == (_END,):
        raise InputError(
            "no heading with the names of the columns, each once", file=file, line=head + 1,
            found=lines[head][:60],
        )  # fmt: skip
    ends = [start for start, _ in starts[1:]] + [None]
    rows = [(i, line) for i, line in enumerate(lines[head + 1 : -1], start=head + 2)]
    cells: dict[str, tuple[str, ...]] = {}
    for (start, name), end in zip(starts, ends, strict=True):
        for i, line in rows:
            if start and len(line) > start and line[start - 1 : start].strip():
                raise InputError(
                    "an entry that reaches into the next column", file=file, line=i, field=name,
                    found=line.strip()[:60],
                )  # fmt: skip
        cells[name] = tuple(line[start:end].strip() for _, line in rows)
    return NcTable(file, names, cells, head + 1, tuple(i for i, _ in rows))
