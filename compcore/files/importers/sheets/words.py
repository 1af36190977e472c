"""Small spreadsheets of other programs: cells, numbers, and the many words for a direction."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.placing import read_bytes
from abbe.compcore.files.text.encodings import decoded
from abbe.compcore.files.text.numbers import checked_number
from abbe.compcore.units import to_internal

_UP = {"+", "+1", "1", "up", "u", "forward", "fwd", "f", "positive", "pos", "p", "↑", "ccw"}
_DOWN = {
    "-",
    "-1",
    "−",
    "−1",
    "down",
    "d",
    "reverse",
    "rev",
    "r",
    "backward",
    "negative",
    "neg",
    "n",
}
_DOWN |= {"↓", "cw"}
_UNITS = {"um", "µm", "mm", "nm", "deg", "rad", "mrad", "urad", "µrad", "arcsec"}


MOST_RUNS = 100_000
_WONDER = 1.0
"""µm: deviations that are all smaller were hardly written in µm."""


@dataclass(frozen=True)
class Sheet:
    """Rows of cells with their line numbers; blank lines and comments left out.

    Attributes
    ----------
    comments
        ``# key = value`` lines, key → value as written.
    data
        The file's bytes.
    """

    file: str
    rows: list[tuple[int, list[str]]]
    comments: dict[str, str]
    data: bytes


def read_sheet(path: Path) -> Sheet:
    """A CSV file whose cells are separated by commas, semicolons or tabs (its header says
    which).

    With semicolons or tabs, decimal commas are understood.

    Raises
    ------
    InputError
        When it holds no rows below a header.
    """
    data = read_bytes(path)
    text = decoded(data)
    rows: list[tuple[int, list[str]]] = []
    comments: dict[str, str] = {}
    separator = ","
    for at, line in enumerate(text.splitlines(), start=1):
        if line.startswith("#"):
            key, equals, value = line[1:].partition("=")
            if equals:
                comments[key.strip().lower()] = value.strip().strip("\"'")
            continue
        # a Siemens control begins its files with their name and folder
        if not line.strip(" \t,;") or line.startswith(("%_N_", ";$PATH=")):
            continue
        if not rows:
            separator = max(",;\t", key=line.count)
        try:
            cells = [c.strip() for c in next(csv.reader([line], delimiter=separator, strict=True))]
        except csv.Error as error:
            raise InputError(f"not a row of CSV: {error}", file=path, line=at) from None
        if separator != ",":
            cells = [c.replace(",", ".") for c in cells]
        rows.append((at, cells))
    if len(rows) < 2:
        raise InputError("no rows", file=path, expected="a header and rows below it")
    width = len(rows[0][1])
    for at, cells in rows:
        if len(cells) != width:
            raise InputError(
                f"too {'few' if len(cells) < width else 'many'} fields",
                file=path,
                line=at,
                found=len(cells),
                expected=f"{width}, as the header has",
            )
    return Sheet(str(path), rows, comments, data)


def unit_of(
    unit: str | None, stated: str | None, values: Sequence[float], file: str, *, rotation: bool
) -> str:
    """The unit of deviations: as given, as the heading says, else µm where that is believable.

    Raises
    ------
    InputError
        When nobody says it and it could as well be another one: angles, or deviations that are all
        below 1, which in µm would be a wonder and in mm are common.
    """
    if unit or stated:
        return unit or stated or ""
    largest = max((abs(v) for v in values), default=0.0)
    if rotation or 0.0 < largest < _WONDER:
        size = f"the largest is {largest:g}"
        likely = "--unit urad, mrad or arcsec" if rotation else "--unit mm, or --unit um"
        raise InputError(
            "the unit of the deviations is not stated",
            file=file,
            field="unit",
            found=size,
            expected=f"{likely}; or a heading such as deviation [{'urad' if rotation else 'mm'}]",
        )
    return "um"


def scale_of(unit: str, internal: str, file: str, line: int | None = None) -> float:
    """One of a unit in mm or rad; raises `InputError` naming file and unit."""
    try:
        return to_internal(1.0, unit, internal)
    except InputError as error:
        raise error.at(file=file, line=line) from None


def whole(text: str, sheet: Sheet, line: int, field: str) -> int:
    """A counting number of a cell (of a run); raises `InputError` naming the place."""
    value = number(text, sheet, line, field)
    if not 0.0 <= value <= MOST_RUNS:
        raise InputError(
            "not believable", file=sheet.file, line=line, field=field, found=text,
            expected=f"0 to {MOST_RUNS}",
        )  # fmt: skip
    return int(value)


def number(text: str, sheet: Sheet, line: int, field: str) -> float:
    """A finite number of a cell; raises `InputError` naming the place."""
    return checked_number(text, file=sheet.file, line=line, field=field)


def as_number(text: str) -> float | None:
    """A finite number, or None."""
    try:
        value = float(text.replace("−", "-"))
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def as_direction(text: str) -> int | None:
    """1 or −1 for a word or sign of a direction, else None.

    >>> as_direction("Up"), as_direction("-"), as_direction("cw"), as_direction("x")
    (1, -1, -1, None)
    """
    word = text.strip().strip("()").lower()
    return 1 if word in _UP else -1 if word in _DOWN else None


def direction(text: str, sheet: Sheet, line: int, field: str) -> int:
    """A direction of a cell; raises `InputError` naming the place."""
    found = as_direction(text)
    if found is None:
        raise InputError(
            "not a direction", file=sheet.file, line=line, field=field, found=text,
            expected="up/down, forward/reverse, ccw/cw, +/-, 1/-1 or ↑/↓",
        )  # fmt: skip
    return found


def split_unit(heading: str) -> tuple[str, str | None]:
    """A heading and the unit in its brackets or behind its last underscore.

    >>> split_unit("Deviation [µm]"), split_unit("angle_deg"), split_unit("run")
    (('deviation', 'µm'), ('angle', 'deg'), ('run', None))
    """
    text = heading.strip().lower()
    for left, right in ("[]", "()"):
        if left in text and text.endswith(right):
            name, _, unit = text[:-1].partition(left)
            return name.strip(), unit.strip()
    name, underscore, unit = text.rpartition("_")
    if underscore and unit in _UNITS:
        return name.strip(), unit
    return text, None
