"""A file of points to be corrected: columns as in a campaign, read in pieces, rows kept as text.

Needed are a column for every axis (mm, rotary degrees) and for every signal that the model reads;
``tool_x`` ``tool_y`` ``tool_z``, ``X_dir`` …, ``time`` and a spindle's angle are optional. All
else is left as it is. Metadata lines (``#``) at the top are optional; with a column ``tool`` they
say what the named tools' offsets are, as in a campaign.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_csv.believable import column_ranges, in_words
from abbe.compcore.files.campaign_csv.columns import TOOL, Columns, name_columns
from abbe.compcore.files.campaign_csv.head import add_metadata, plain_line, read_head
from abbe.compcore.files.campaign_csv.lines import LineSource, csv_cells
from abbe.compcore.files.text.numbers import checked_number
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

_PIECE = 16_384
"""Rows worked on at once: a few MB of basis functions."""


@dataclass(frozen=True, eq=False)
class PointBlock:
    """Some rows of a file of points.

    Attributes
    ----------
    text
        The rows as they stand in the file, without line ends.
    line
        Their line numbers, shape (n,).
    columns
        Column name → values, shape (n,), in the file's units; tool offsets under tool_x …
    """

    text: list[str]
    line: NDArray[np.int64]
    columns: dict[str, F64] = field(default_factory=dict)


class PointsFile(AbstractContextManager["PointsFile"]):
    """A file of points, read once from beginning to end.

    Parameters
    ----------
    path, machine
        The file and the machine whose axes and signals give the columns their meaning.
    signals
        Signals that are read where the file has them; other columns are left alone.

    Attributes
    ----------
    top
        The lines above the header as they stand in the file.
    header
        The header line as it stands in the file.
    columns
        What the columns are.

    Raises
    ------
    InputError
        Naming file, line, column, what was found and what was expected.
    """

    top: list[str]
    header: str
    columns: Columns

    def __init__(self, path: str | Path, machine: Machine, signals: Sequence[str]) -> None:
        self.file = str(path)
        self._source = LineSource(path)
        self._machine = machine
        self._signals = signals
        self._rest: tuple[int, list[str]] = (1, [])

    def __enter__(self) -> Self:
        self._source.__enter__()
        try:
            self._open()
        except BaseException:
            self._source.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._source.__exit__()

    def _open(self) -> None:
        self._chunks = self._source.chunks()
        self.top = []
        plain: list[str] = []
        for first, lines in self._chunks:
            for i, text in enumerate(lines):
                if (metadata := plain_line(text)) is not None:
                    self.top.append(text)
                    add_metadata(plain, metadata, self.file)
                    continue
                self.header, line = text, first + i
                self._rest = (line + 1, lines[i + 1 :])
                cells = csv_cells(text, self.file, line, "a header line")
                self.columns = name_columns(cells, self._machine, self.file, line)
                self._tools = self._named_tools(plain)
                self._wanted = self._numbers()
                ranges = column_ranges(self.columns, self._machine)
                self._ranges = [(n, *ranges[n]) for n in self._wanted if n in ranges]
                return
        raise InputError(
            "the header is missing",
            file=self.file,
            line=len(self.top) + 1,
            expected="a line with the names of the columns",
        )

    def _named_tools(self, plain: list[str]) -> dict[str, tuple[float, float, float]]:
        if "tool" not in self.columns:
            return {}
        return {tool.name: tool.offset for tool in read_head(plain, self.file).tools.values()}

    def _numbers(self) -> list[str]:
        """The columns that are read as numbers, in the file's order."""
        c = self.columns
        wanted = {*c.positions.values(), *c.directions.values(), *self._signals, *TOOL, "time"}
        if c.spindle:
            wanted.add(c.spindle)
        return [name for name in c.header if name in wanted]

    def blocks(self) -> Iterator[PointBlock]:
        """The rows, some thousand at a time; blank lines are passed over."""
        yield from self._pieces(*self._rest)
        for first, lines in self._chunks:
            yield from self._pieces(first, lines)

    def _pieces(self, first: int, lines: list[str]) -> Iterator[PointBlock]:
        for start in range(0, len(lines), _PIECE):
            part = lines[start : start + _PIECE]
            line = np.arange(first + start, first + start + len(part), dtype=np.int64)
            kept = [i for i, text in enumerate(part) if text and not text.isspace()]
            if len(kept) < len(part):
                part, line = [part[i] for i in kept], line[kept]
            if part:
                yield self._block(part, line)

    def _block(self, text: list[str], line: NDArray[np.int64]) -> PointBlock:
        numbers = self._fast(text)
        if numbers is None:
            numbers = self._slow(text, line)
        columns = dict(zip(self._wanted, numbers.T, strict=True))
        for name, allowed, why in self._ranges:
            outside = allowed.outside(columns[name])
            if outside.any():
                row = int(outside.argmax())
                found = f"{columns[name][row]:g}"
                raise self._error(line[row], name, "not believable", found, in_words(allowed, why))
        for column in self.columns.directions.values():
            wrong = ~np.isin(columns[column], (-1.0, 0.0, 1.0))
            if wrong.any():
                row = int(wrong.argmax())
                raise self._error(
                    line[row],
                    column,
                    "not a direction",
                    f"{columns[column][row]:g}",
                    "1, -1, or 0 for not moved or unknown",
                )
        if self._tools or "tool" in self.columns:
            self._put_tools(text, line, columns)
        return PointBlock(text, line, columns)

    def _fast(self, text: list[str]) -> F64 | None:
        """The common case; None when anything deserves a closer look."""
        commas = len(self.columns.header) - 1
        if any(row.count(",") != commas for row in text) or any('"' in row for row in text):
            return None
        places = [self.columns.index(name) for name in self._wanted]
        try:
            found = np.loadtxt(text, delimiter=",", usecols=places, comments=None, ndmin=2)
        except ValueError:
            return None
        return found if np.isfinite(found).all() else None

    def _slow(self, text: list[str], line: NDArray[np.int64]) -> F64:
        width = len(self.columns.header)
        places = [self.columns.index(name) for name in self._wanted]
        numbers = np.empty((len(text), len(places)))
        for i, row in enumerate(text):
            cells = csv_cells(row, self.file, int(line[i]), "a row of CSV")
            if len(cells) != width:
                raise InputError(
                    f"too {'few' if len(cells) < width else 'many'} fields",
                    file=self.file,
                    line=int(line[i]),
                    found=len(cells),
                    expected=f"{width}, as the header has",
                )
            for k, (at, name) in enumerate(zip(places, self._wanted, strict=True)):
                numbers[i, k] = self._number(cells[at].strip(), name, line[i])
        return numbers

    def _number(self, text: str, name: str, line: np.int64) -> float:
        if not text and (name in TOOL or name in self.columns.directions.values()):
            return 0.0
        return checked_number(text, file=self.file, line=int(line), field=name)

    def _put_tools(self, text: list[str], line: NDArray[np.int64], columns: dict[str, F64]) -> None:
        at = self.columns.index("tool")
        cells = (
            csv_cells(row, self.file, int(i), "a row of CSV")
            for row, i in zip(text, line, strict=True)
        )
        names = [row[at].strip() for row in cells]
        zero = np.zeros(len(text))
        offset = np.stack([columns.get(name, zero) for name in TOOL], axis=1)
        for i, name in enumerate(names):
            if name and name not in self._tools:
                known = ", ".join(self._tools) or "none declared"
                raise self._error(
                    line[i], "tool", "not declared at the top of the file", name, f"one of {known}"
                )
            if name:
                offset[i] = self._tools[name]
        columns.update(zip(TOOL, offset.T, strict=True))

    def _error(
        self, line: np.int64, column: str, problem: str, found: str, expected: str
    ) -> InputError:
        return InputError(
            problem, file=self.file, line=int(line), field=column, found=found, expected=expected
        )
