"""Rows of comma-separated numbers and names to columns, fast, with exact places for errors.

A few MB of text are taken apart at once: where the separators are, then all numbers together
(`numpy.loadtxt`), then the names. Whatever that cannot read (quoted cells, blank lines, a text
where a number belongs) goes row by row through `csv` instead, which reads it or says where it is
wrong. Both give the same numbers.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_csv.columns import NAMES, Columns
from abbe.compcore.files.campaign_csv.lines import csv_cells
from abbe.compcore.files.campaign_csv.store import Names
from abbe.compcore.sentences import said

F64 = NDArray[np.float64]

_COMMA, _LINE_END, _HASH = (np.uint8(ord(c)) for c in ",\n#")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True)
class CsvBlock:
    """Some rows of a comma-separated file, column by column.

    Attributes
    ----------
    text
        The rows as they stand in the file.
    line
        Line number of each row, shape (n,).
    numbers
        Shape (n, number columns): NaN where the cell is blank.
    names
        Name column → the cells.
    """

    text: list[str]
    line: NDArray[np.int64]
    numbers: F64
    names: dict[str, Names]


def parse_rows(first: int, lines: list[str], columns: Columns) -> CsvBlock:
    """Parse whole lines; blank lines are passed over.

    Parameters
    ----------
    first
        Line number of the first.

    Raises
    ------
    InputError
        A row with too few or too many fields, a text where a number belongs, NaN, infinity.
    """
    line = np.arange(first, first + len(lines), dtype=np.int64)
    parsed = _fast(lines, columns) if lines else None
    if parsed is None:
        kept = [i for i, text in enumerate(lines) if text and not text.isspace()]
        lines, line = [lines[i] for i in kept], line[kept]
        parsed = _slow(lines, line, columns)
    return CsvBlock(lines, line, *parsed)


def cell(text: str, columns: Columns, name: str) -> str:
    """One cell of a row, for an error message."""
    try:
        fields = next(csv.reader([text]))
    except csv.Error:
        fields = text.split(",")
    at = columns.index(name)
    return fields[at].strip() if at < len(fields) else ""


def _fast(lines: list[str], columns: Columns) -> tuple[F64, dict[str, Names]] | None:
    """The common case; None when there is anything that deserves a closer look."""
    text = ("\n".join(lines) + "\n").encode("utf-8")
    if b'"' in text or b"\r" in text:
        return None
    n, width = len(lines), len(columns.header)
    characters = np.frombuffer(text, dtype=np.uint8)
    separators = np.flatnonzero((characters == _COMMA) | (characters == _LINE_END))
    if len(separators) != n * width:
        return None
    ends = separators.reshape(n, width)
    starts = np.concatenate([[0], separators[:-1] + 1]).reshape(n, width)
    if (characters[ends[:, -1]] != _LINE_END).any() or (characters[starts[:, 0]] == _HASH).any():
        return None
    wanted = [i for i, name in enumerate(columns.header) if name not in NAMES]
    blank = (ends == starts)[:, wanted]
    filled = _blanks_filled(text) if blank.any() else text
    try:
        numbers = np.loadtxt(
            io.BytesIO(filled),
            delimiter=",",
            usecols=wanted,
            comments=None,
            ndmin=2,
            encoding="utf-8",
        )
    except ValueError:
        return None
    if numbers.shape != blank.shape or (np.isfinite(numbers) == blank).any():
        return None
    names = {}
    for name in NAMES:
        if name in columns:
            at = columns.index(name)
            places = zip(starts[:, at].tolist(), ends[:, at].tolist(), strict=True)
            names[name] = Names.of([text[a:b] for a, b in places])
    return numbers, names


def _blanks_filled(text: bytes) -> bytes:
    """The rows with `nan` in every blank cell, as `numpy.loadtxt` wants it."""
    for _ in range(2):  # of two blank cells side by side the first pass fills one
        text = text.replace(b",,", b",nan,")
    text = text.replace(b",\n", b",nan\n").replace(b"\n,", b"\nnan,")
    return b"nan" + text if text.startswith(b",") else text


def _slow(
    lines: Sequence[str], line: NDArray[np.int64], columns: Columns
) -> tuple[F64, dict[str, Names]]:
    width = len(columns.header)
    names: dict[str, list[str]] = {name: [] for name in NAMES if name in columns}
    numbers = np.empty((len(lines), len(columns.numbers)))
    for i, text in enumerate(lines):
        here = int(line[i])
        if text.startswith("#"):
            raise InputError(
                "metadata below the header",
                file=columns.file,
                line=here,
                found=text[:40],
                expected="metadata lines at the top of the file only",
            )
        fields = csv_cells(text, columns.file, here, said("a row of CSV"))
        if len(fields) != width:
            raise InputError(
                said("too few fields") if len(fields) < width else said("too many fields"),
                file=columns.file,
                line=here,
                found=len(fields),
                expected=said("{n}, as the header has", n=width),
            )
        at = 0
        for name, raw in zip(columns.header, fields, strict=True):
            if name in names:
                names[name].append(raw.strip())
                continue
            numbers[i, at] = _number(raw.strip(), name, columns, here)
            at += 1
    return numbers, {name: Names.of([c.encode() for c in cells]) for name, cells in names.items()}


def _number(text: str, name: str, columns: Columns, line: int) -> float:
    if not text:
        return math.nan
    value = float(text) if _NUMBER.fullmatch(text) else math.nan
    if math.isfinite(value):
        return value
    expected = said("a finite number")
    if name in columns.signals:
        expected = said("a finite number (every column that has no meaning of its own is a signal)")
    raise InputError(
        "not a number", file=columns.file, line=line, field=name, found=text, expected=expected
    )
