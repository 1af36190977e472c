"""A logger's table to a campaign: a row a moment, thermometers and indicators in columns.

What a thermal test writes (ISO 230-3: environment, spindle, linear motion): ``time, T_air, T_bed,
dX, dY, dZ``. Which columns are readings of the machine's error is said by their names (``dX`` …
``dC``) or by the caller; columns named as axes are positions; all other numbers are signals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.placing import (
    COMPONENTS,
    F64,
    I64,
    ForeignPlacing,
    Readings,
    place,
)
from abbe.compcore.files.importers.sheets.logged import (
    LoggedColumn,
    clock_of,
    column_name,
    columns_of,
    is_axis,
    numbers_of,
    signal_of,
    times_of,
)
from abbe.compcore.files.importers.sheets.words import (
    Sheet,
    as_number,
    number,
    read_sheet,
    scale_of,
    split_unit,
    unit_of,
)
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary

_ERRORS = {f"d{c.lower()}": c for c in COMPONENTS}


@dataclass(frozen=True)
class LoggedReading:
    """What a column of a log measures.

    Attributes
    ----------
    component
        X Y Z: displacement along; A B C: rotation about X Y Z.
    tool
        Offset of the point that the indicator touches, mm; None: that of the placing.
    """

    component: str
    tool: tuple[float, float, float] | None = None


def import_log(
    path: str | Path,
    placing: ForeignPlacing | None = None,
    *,
    measured: Mapping[str, LoggedReading] | None = None,
    unit: str | None = None,
    machine: Machine | None = None,
) -> Campaign:
    """Read a logger's table.

    Parameters
    ----------
    measured
        Column → what it measures; where None, columns called ``dX`` … ``dC``.
    unit
        Unit of the readings; where None their headings', else µm where that is believable.
    machine
        Where given, only its axes' names are columns of positions.

    Raises
    ------
    InputError
        Naming file, line, column, what was found and what was expected.
    """
    source, placing = Path(path), placing or ForeignPlacing()
    sheet = read_sheet(source)
    columns = columns_of(sheet)
    readings = _measured(columns, measured, sheet)
    clock = clock_of(columns)
    lines = np.array([line for line, _ in sheet.rows[1:]])
    time, date = times_of(clock, sheet)
    rest = [c for c in columns.values() if c not in clock and c.name not in readings]
    text = [c.name for c in rest if as_number(sheet.rows[1][1][c.place]) is None]
    axes = {c.name: c for c in rest if is_axis(c.name, machine) and c.name not in text}
    signals = {
        c.name: signal_of(c, sheet) for c in rest if c.name not in axes and c.name not in text
    }
    positions = {
        name: np.deg2rad(numbers_of(c, sheet)) if is_rotary(name) else numbers_of(c, sheet)
        for name, c in axes.items()
    }
    rows, notes, blank = [], [], 0
    for name, what in readings.items():
        c = columns[name]
        has = np.array([bool(cells[c.place]) for _, cells in sheet.rows[1:]])
        values = np.array([number(cells[c.place], sheet, line, name)
                           for line, cells in sheet.rows[1:] if cells[c.place]])  # fmt: skip
        if not len(values):
            raise InputError("a column without readings", file=source, field=name)
        rotation = what.component in "ABC"
        said = unit_of(unit, c.unit, values.tolist(), sheet.file, rotation=rotation)
        scale = scale_of(said, "rad" if rotation else "mm", sheet.file)
        blank += int((~has).sum())
        rows.append(_placed(name, what, values * scale, lines, time, positions, signals, has))
        notes.append(f"{name} is the error {_meaning(what)}, in {said}")
    minus = "−" if placing.sign < 0 else ""
    head = [
        f"imported from {source.name} (log)",
        f"sign: error = {minus}reading as logged: positive where the tool moves in the axis's "
        "direction against the workpiece",
        *notes,
        *([f"positions: {', '.join(axes)}"] if axes else []),
        *([f"signals: {', '.join(signals)}"] if signals else []),
        *([f"left out, since no numbers: {', '.join(text)}"] if text else []),
        *([f"{blank} blank readings left out"] if blank else []),
        *(["no clock: no drift, warm-up or lag can be looked for"] if not clock else []),
    ]
    metadata = {} if date is None else {"date": date}
    return place(source, sheet.data, rows, placing, head, metadata, machine)


def _meaning(what: LoggedReading) -> str:
    along = "about" if what.component in "ABC" else "along"
    axis = "XYZ"[COMPONENTS.index(what.component) % 3]
    at = "" if what.tool is None else " at tool " + ", ".join(f"{x:g}" for x in what.tool)
    return f"{along} {axis}{at}"


def _placed(
    name: str,
    what: LoggedReading,
    value: F64,
    lines: I64,
    time: F64,
    positions: Mapping[str, F64],
    signals: Mapping[str, F64],
    has: NDArray[np.bool_],
) -> Readings:
    """Readings of one column: each indicator has a zero of its own."""
    n = len(value)
    u = np.zeros((n, 3))
    u[:, COMPONENTS.index(what.component) % 3] = 1.0
    return Readings(
        positions={a: q[has] for a, q in positions.items()},
        directions=dict.fromkeys(positions, np.zeros(n, dtype=np.int64)),
        kind=Kind.ROTATION if what.component in "ABC" else Kind.DISPLACEMENT,
        value=value,
        u=u,
        free=("zero",),
        line=lines[has],
        suffix=f"_{name}",
        signals={s: v[has] for s, v in signals.items()},
        tool=None if what.tool is None else np.tile(what.tool, (n, 1)),
        time=time[has],
    )


def _measured(
    columns: Mapping[str, LoggedColumn], asked: Mapping[str, LoggedReading] | None, sheet: Sheet
) -> dict[str, LoggedReading]:
    named = {column_name(name): what for name, what in (asked or {}).items()} or {
        name: LoggedReading(_ERRORS[split_unit(name)[0]])
        for name in columns
        if split_unit(name)[0] in _ERRORS
    }
    for name in named:
        if name not in columns:
            raise InputError(
                "no such column", file=sheet.file, line=sheet.rows[0][0], field=name,
                found=", ".join(columns),
            )  # fmt: skip
    if not named:
        raise InputError(
            "not a log whose readings are known",
            file=sheet.file,
            line=sheet.rows[0][0],
            found=", ".join(columns),
            expected="columns called dX dY dZ (along) or dA dB dC (about X Y Z), "
            "or --measured COLUMN=Z",
        )
    return named
