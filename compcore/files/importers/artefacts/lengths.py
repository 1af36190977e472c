"""Measured gauge blocks, step gauges and other calibrated lengths: a CSV of a row per length.

One row per reading (``position, calibrated, run, measured``), one row per length with a column per
repeat (``position, calibrated, 1, 2, 3``), or the two probed points in place of the measured length
(``x1 … z2``). docs/gauges.md lists the columns.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.calibrated_length import CalibratedLength
from abbe.compcore.artefacts.iso10360 import TESTS
from abbe.compcore.artefacts.measured_length import MeasuredLength
from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.sheets.roles import (
    EXPANSION,
    STANDARD_TEMPERATURE,
    STANDARD_TEMPERATURE_SD,
    STANDARD_WORDS,
    TOOL_WORDS,
    RoleColumns,
    Words,
    calibration_sd,
)
from abbe.compcore.files.importers.sheets.words import (
    as_number,
    read_sheet,
    scale_of,
    split_unit,
    unit_of,
    whole,
)
from abbe.compcore.machine.plausible import TRAVEL, Range

F64 = NDArray[np.float64]

ENDS = ("x1", "y1", "z1", "x2", "y2", "z2")
_WORDS: Words = {
    "position": ("position", "orientation", "placing", "place", "line"),
    "calibrated": ("calibrated", "length", "nominal", "reference", "calibrated length"),
    "measured": ("measured", "indicated", "measured length"),
    "error": ("error", "deviation", "dev"),
    "run": ("run", "repeat", "no"),
    "test": ("test",),
    **STANDARD_WORDS,
    **TOOL_WORDS,
    **{name: (name,) for name in ENDS},
}
_REPEAT = re.compile(r"(?:(measured|error|run|repeat|m|e)[ _]?)?(\d{1,3})", re.IGNORECASE)
_LENGTH = Range(1e-3, 1e5, "mm")
_ERROR = Range(-100.0, 100.0, "mm")


@dataclass(frozen=True, eq=False)
class _Header:
    """What the columns are.

    `repeats`: column → run, and whether it holds errors. `per_unit`: mm of a unit of errors.
    """

    columns: RoleColumns
    repeats: Mapping[int, tuple[int, bool]]
    per_unit: float = 1.0


def read_lengths(
    path: str | Path,
    *,
    reduced: bool | None = None,
    unit: str | None = None,
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[list[MeasuredLength], bytes]:
    """Read measured lengths, and the file's bytes.

    Parameters
    ----------
    reduced
        Whether measured lengths are already reduced to 20 °C. Must be given where the file states a
        temperature and an expansion besides measured lengths; probed points never are.
    unit
        Of columns of errors; where None the heading's, else µm where that is believable.
    tool
        Offset of the probe's tip where the file does not say it, mm.

    Raises
    ------
    InputError
        Naming file, line, column, what was found and what was expected.
    """
    header = _header(RoleColumns.of(read_sheet(Path(path)), _WORDS), unit)
    sheet, where = header.columns.sheet, header.columns.where
    states_growth = header.columns.states("temperature") and header.columns.states("expansion")
    states_lengths = {"measured", "error"} & set(where) or header.repeats
    if states_growth and states_lengths and reduced is None:
        raise InputError(
            "the file states temperature and expansion, but not whether the lengths are reduced "
            "to 20 °C",
            file=sheet.file,
            field="reduced",
            expected="--reduced (the machine's software has done it) or --not-reduced",
        )
    return [
        replace(length, temperature=None) if reduced and states_lengths else length
        for line, cells in sheet.rows[1:]
        for length in _lengths(header, line, cells, tool)
    ], sheet.data


def _header(columns: RoleColumns, unit: str | None) -> _Header:
    sheet = columns.sheet
    line, cells = sheet.rows[0]
    repeats: dict[int, tuple[int, bool]] = {}
    signals: dict[str, int] = {}
    stated = columns.units.get("error")
    for name, i in columns.others.items():
        bare, own_unit = split_unit(name)
        match = _REPEAT.fullmatch(bare)
        if match is None:
            signals[name] = i
            continue
        repeats[i] = (int(match[2]), (match[1] or "").lower() in ("error", "e"))
        stated = own_unit if own_unit and repeats[i][1] else stated
    where = columns.where
    probed = all(name in where for name in ENDS)
    if "calibrated" not in where or not ({"measured", "error"} & set(where) or repeats or probed):
        raise InputError(
            "not a table of measured lengths",
            file=sheet.file,
            line=line,
            found=", ".join(cells),
            expected="position,calibrated,run,measured; or position,calibrated,1,2,3; "
            "or position,calibrated,x1,y1,z1,x2,y2,z2",
        )
    columns = replace(columns, others=signals)
    own = [i for i, (_, is_error) in repeats.items() if is_error]
    own += [where["error"]] if "error" in where else []
    errors = [v for _, row in sheet.rows[1:] for i in own if (v := as_number(row[i])) is not None]
    if not errors:
        return _Header(columns, repeats)
    unit = unit_of(unit, stated, errors, sheet.file, rotation=False)
    return _Header(columns, repeats, scale_of(unit, "mm", sheet.file, line))


def _lengths(
    header: _Header, line: int, cells: list[str], tool: tuple[float, float, float]
) -> Iterator[MeasuredLength]:
    """The lengths of one row."""
    columns = header.columns
    calibrated = CalibratedLength(
        columns.number(line, cells, "calibrated", _LENGTH),
        calibration_sd(columns, line, cells),
        columns.number(line, cells, "expansion", EXPANSION, 0.0) * 1e-6,
        columns.number(line, cells, "expansion_sd", EXPANSION, 0.0) * 1e-6,
    )
    temperature = None
    if columns.states("temperature"):
        temperature = columns.number(line, cells, "temperature", STANDARD_TEMPERATURE)
    ends = None
    if all(name in columns.where for name in ENDS):
        place = [columns.number(line, cells, name, TRAVEL) for name in ENDS]
        ends = np.array(place).reshape(2, 3)
    test = columns.text(cells, "test", "E0").upper()
    if test not in TESTS:
        raise InputError(
            "no such test", file=columns.sheet.file, line=line, field="test", found=test,
            expected=" or ".join(TESTS),
        )  # fmt: skip
    for run, measured in _readings(header, line, cells, calibrated, ends):
        yield MeasuredLength(
            columns.text(cells, "position", ""),
            calibrated,
            measured,
            run,
            temperature,
            columns.number(line, cells, "temperature_sd", STANDARD_TEMPERATURE_SD, 0.0),
            test,
            ends,
            columns.tool(line, cells, tool),
            columns.signals(line, cells),
            line,
        )


def _readings(
    header: _Header, line: int, cells: list[str], calibrated: CalibratedLength, ends: F64 | None
) -> Iterator[tuple[int, float]]:
    """(run, measured length in mm); an error as software states it is that of 20 °C."""
    columns, sheet = header.columns, header.columns.sheet
    where = columns.where
    run = whole(cells[where["run"]], sheet, line, "run") if "run" in where else 1
    if "measured" in where:
        yield run, columns.number(line, cells, "measured", _LENGTH)
    elif "error" in where:
        error = columns.cell(line, cells, where["error"], "error", _ERROR, header.per_unit)
        yield run, calibrated.length + error
    elif header.repeats:
        for i, (repeat, is_error) in header.repeats.items():
            heading = sheet.rows[0][1][i]
            if not cells[i]:
                continue
            if is_error:
                error = columns.cell(line, cells, i, heading, _ERROR, header.per_unit)
                yield repeat, calibrated.length + error
            else:
                yield repeat, columns.cell(line, cells, i, heading, _LENGTH)
    elif ends is not None:
        measured = float(np.linalg.norm(ends[1] - ends[0]))
        if not _LENGTH.holds(measured):
            raise InputError(
                "two probed points at one place", file=sheet.file, line=line, field="x2",
                expected="the two ends of the length",
            )  # fmt: skip
        yield run, measured
