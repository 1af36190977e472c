"""Moments of time as loggers write them: seconds, dates, hours of the day."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime, timedelta
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.sheets.words import Sheet, as_number

F64 = NDArray[np.float64]

SECONDS = {
    **dict.fromkeys(("ms", "msec"), 1e-3),
    **dict.fromkeys(("", "s", "sec", "second", "seconds"), 1.0),
    **dict.fromkeys(("min", "mins", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86400.0),
}
"""Unit of a heading → s."""

_YEAR_FIRST = re.compile(r"(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})(?:[-T ,;]+(.*))?")
_DAY_FIRST = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})(?:[-T ,;]+(.*))?")
_OF_DAY = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,]\d{1,9})?))?")
_ZONE = re.compile(r"\s*(Z|[+-]\d{2}:?\d{2})$")
_DAY = 86400.0


def seconds(cells: Sequence[str], lines: Sequence[int], unit: str, field: str, sheet: Sheet) -> F64:
    """Seconds since the first row, shape (n,).

    Numbers are in the heading's unit; dates have the year first (``2026-03-02 14:05:00``) or
    points between (``02.03.2026 14:05:00``); hours of the day alone run on over midnight.

    Raises
    ------
    InputError
        For what is no moment, or a clock that goes back; names the line.
    """
    first = cells[0]
    if as_number(first) is not None:
        if unit not in SECONDS:
            raise InputError(
                "not a unit of time", file=sheet.file, field=field, found=unit,
                expected="ms, s, min, h or d",
            )  # fmt: skip
        found = [
            _number(c, at, field, sheet) * SECONDS[unit] for c, at in zip(cells, lines, strict=True)
        ]
    else:
        found = [_moment(c, at, field, sheet) for c, at in zip(cells, lines, strict=True)]
        if _OF_DAY.fullmatch(first):
            found = _over_midnight(found)
    t = np.array(found) - found[0]
    back = np.flatnonzero(np.diff(t) < 0.0)
    if len(back):
        i = int(back[0])
        raise InputError(
            "the clock goes back",
            file=sheet.file,
            line=lines[i + 1],
            field=field,
            found=f"{cells[i + 1]} after {cells[i]}",
            expected="rows in the order of time, one run a file",
        )
    return t


def date_of(cell: str) -> str | None:
    """The day of a moment, ``2026-03-02``; None where it states none."""
    day = _day(cell)
    return None if day is None else day[0].date().isoformat()


def _number(cell: str, line: int, field: str, sheet: Sheet) -> float:
    value = as_number(cell)
    if value is None:
        raise _none(cell, line, field, sheet)
    return value


def _day(cell: str) -> tuple[datetime, str] | None:
    """The day of a cell, and what stands behind it."""
    if match := _YEAR_FIRST.fullmatch(cell):
        year, month, day, rest = match.groups()
    elif match := _DAY_FIRST.fullmatch(cell):
        day, month, year, rest = match.groups()
    else:
        return None
    try:
        return datetime(int(year), int(month), int(day)), rest or ""
    except ValueError:
        return None


def _moment(cell: str, line: int, field: str, sheet: Sheet) -> float:
    found = _day(cell)
    start, text = found if found is not None else (datetime.min, cell)
    text = _ZONE.sub("", text)
    of_day = _OF_DAY.fullmatch(text)
    if of_day is None and (found is None or text):
        raise _none(cell, line, field, sheet)
    hours, minutes, rest = of_day.groups() if of_day else ("0", "0", None)
    moment = start + timedelta(
        hours=int(hours), minutes=int(minutes), seconds=float((rest or "0").replace(",", "."))
    )
    return (moment - datetime.min).total_seconds()


def _over_midnight(moments: Sequence[float]) -> list[float]:
    """Hours of the day as they go on over midnight: back by over half a day is the next day."""
    found, days = [moments[0]], 0.0
    for before, now in pairwise(moments):
        days += _DAY if now - before < -0.5 * _DAY else 0.0
        found.append(now + days)
    return found


def _none(cell: str, line: int, field: str, sheet: Sheet) -> InputError:
    return InputError(
        "not a moment of time",
        file=sheet.file,
        line=line,
        field=field,
        found=cell,
        expected="seconds (or a unit in the heading: time [min]), 2026-03-02 14:05:00, "
        "02.03.2026 14:05:00 or 14:05:00; month/day/year is not taken, since it may be day/month",
    )
