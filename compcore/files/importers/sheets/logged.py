"""A table in which each row is a moment: its columns, its clock, positions of axes and signals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_csv.columns import AXIS, RESERVED
from abbe.compcore.files.importers.sheets.moments import date_of, seconds
from abbe.compcore.files.importers.sheets.words import Sheet, number, split_unit
from abbe.compcore.machine.machine import Machine

F64 = NDArray[np.float64]

_TIME = ("time", "timestamp", "datetime", "date_time", "t", "elapsed", "elapsed_time", "seconds")
_DATE = ("date", "day")
_FAHRENHEIT = ("°f", "degf", "f")


@dataclass(frozen=True)
class LoggedColumn:
    """A column: its place, its name without the unit, and the unit of its heading."""

    place: int
    name: str
    unit: str | None


def columns_of(sheet: Sheet) -> dict[str, LoggedColumn]:
    """The columns of a table by their names, units taken off.

    Raises
    ------
    InputError
        When a column has no name, or two have the same.
    """
    line, header = sheet.rows[0]
    found: dict[str, LoggedColumn] = {}
    for i, cell in enumerate(header):
        name = column_name(cell)
        if not name or name in found:
            raise InputError(
                f"column {i + 1} has no name" if not name else "the same column twice",
                file=sheet.file,
                line=line,
                field=name or None,
                expected="a name per column, every name once",
            )
        unit = split_unit(cell)[1]
        found[name] = LoggedColumn(i, name, None if unit and unit.isdigit() else unit)
    return found


def column_name(heading: str) -> str:
    """What a column is called: its heading without the unit in brackets, blanks as underscores.

    A number in brackets is no unit: it tells columns apart.

    >>> column_name("Deviation [µm]"), column_name("target pos (5)"), column_name("T")
    ('Deviation', 'target_pos_5', 'T')
    """
    text = heading.strip()
    if text.endswith(("]", ")")):
        end = min((text.find(b) for b in "[(" if b in text), default=-1)
        inside = text[end + 1 : -1].strip()
        text = f"{text[:end].strip()} {inside}" if inside.isdigit() else text[:end].strip()
    return text.replace(" ", "_")


def clock_of(columns: Mapping[str, LoggedColumn]) -> list[LoggedColumn]:
    """The columns of the clock: one, or a date and an hour; none where nothing is called so."""
    lower = {name.lower(): c for name, c in columns.items()}
    bases = {split_time(name): c for name, c in lower.items()}
    time = next((bases[n] for n in _TIME if n in bases), None)
    date = next((lower[n] for n in _DATE if n in lower), None)
    return [c for c in (date, time) if c is not None]


def split_time(name: str) -> str:
    """The heading of a clock without its unit.

    >>> split_time("time_s"), split_time("elapsed_min"), split_time("time")
    ('time', 'elapsed', 'time')
    """
    base, _, unit = name.rpartition("_")
    return base if unit in ("s", "ms", "min", "h", "sec") and base else name


def times_of(clock: list[LoggedColumn], sheet: Sheet) -> tuple[F64, str | None]:
    """Seconds of each row since the first, (n,), and the date; zeros without a clock.

    Raises
    ------
    InputError
        When a cell is no time.
    """
    rows = sheet.rows[1:]
    if not clock:
        return np.zeros(len(rows)), None
    cells = [" ".join(cells[c.place] for c in clock) for _, cells in rows]
    last = clock[-1]
    low = last.name.lower()
    unit = last.unit or (low.rpartition("_")[2] if split_time(low) != low else "s")
    time = seconds(cells, [line for line, _ in rows], unit, last.name, sheet)
    return time, date_of(cells[0])


def is_axis(name: str, machine: Machine | None) -> bool:
    """Whether a column holds positions of an axis: of the machine's, or by its name."""
    return AXIS.fullmatch(name) is not None if machine is None else name in machine.axes


def numbers_of(column: LoggedColumn, sheet: Sheet) -> F64:
    """The numbers of a column, (n,).

    Raises
    ------
    InputError
        When a cell is no number.
    """
    return np.array(
        [number(cells[column.place], sheet, line, column.name) for line, cells in sheet.rows[1:]]
    )


def signal_of(column: LoggedColumn, sheet: Sheet) -> F64:
    """The readings of a signal, (n,), °F as °C.

    Raises
    ------
    InputError
        When a cell is no number, or the name has a meaning of its own in a campaign.
    """
    if column.name in RESERVED:
        raise InputError(
            "a column with a meaning of its own in a campaign",
            file=sheet.file,
            line=sheet.rows[0][0],
            field=column.name,
            expected="another name",
        )
    values = numbers_of(column, sheet)
    return (values - 32.0) / 1.8 if (column.unit or "") in _FAHRENHEIT else values
