"""Tables of runs and directions, as ISO 230-2 prints them, to a campaign.

Three layouts, told apart by the header (docs/campaigns.md):

long        a row per reading: ``position, run, direction, deviation``
by target   a row per target, a column per run and direction: ``target, 1+, 1-, 2+, 2-, …``
by run      a row per run and direction, a column per target: ``run, direction, 0, 100, 200, …``

Deviations are x_ij = P_ij − P_i, actual minus target (ISO 230-2): Abbe's own sign.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.placing import ForeignPlacing, along_line, component_of, place
from abbe.compcore.files.importers.sheets.words import (
    Sheet,
    as_direction,
    as_number,
    direction,
    number,
    read_sheet,
    scale_of,
    split_unit,
    unit_of,
    whole,
)
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary

_POSITION = {"position", "target", "target_position", "p", "p_i", "x", "y", "z"}
_RUN = {"run", "j", "no"}
_DIRECTION = {"direction", "dir", "approach"}
_DEVIATION = {"deviation", "error", "value", "x_ij", "dev"}
_RUN_COLUMN = re.compile(r"(?:run\s*)?(\d{1,5})\s*[ _]?\s*(\S+)|(\S+?)\s*(\d{1,5})", re.IGNORECASE)

Reading = tuple[float, int, int, float, int]
"""Target, run, direction, deviation (units of the file), line."""


def import_iso230_table(
    path: str | Path,
    axis: str,
    placing: ForeignPlacing | None = None,
    *,
    component: str | None = None,
    unit: str | None = None,
    machine: Machine | None = None,
) -> Campaign:
    """Read a table of runs and directions.

    Parameters
    ----------
    axis
        The axis that moved.
    component
        What was measured (X Y Z A B C); the axis's own positioning where None.
    unit
        Unit of the deviations; where None the header's, else µm where that is believable.

    Raises
    ------
    InputError
        Naming file, line, column, what was found and what was expected.
    """
    source = Path(path)
    sheet = read_sheet(source)
    component = component_of(axis, component)
    readings, layout, stated = _readings(sheet)
    values, rotation = [r[3] for r in readings], component in "ABC"
    said = unit is not None or stated is not None
    unit = unit_of(unit, stated, values, sheet.file, rotation=rotation)
    scale = scale_of(unit, "rad" if component in "ABC" else "mm", sheet.file)
    # runs in their order, each up before down, targets in the order of travel
    readings.sort(key=lambda r: (r[1], -r[2], r[0] * r[2]))
    target, _, sense, deviation, line = (np.array(c) for c in zip(*readings, strict=True))
    position = np.deg2rad(target) if is_rotary(axis) else target
    rows = along_line(axis, component, position, sense, deviation * scale, line)
    reversed_ = placing is not None and placing.sign < 0
    notes = [
        f"imported from {source.name} (ISO 230-2 table, {layout})",
        f"sign: error = {'−' if reversed_ else ''}deviation as tabulated"
        + (" (actual − target, ISO 230-2)" if not reversed_ else " (reversed as asked)"),
        f"deviations in {unit}" + ("" if said else ", as no heading and no --unit says otherwise"),
        "the file has no times: order of the standard test cycle assumed",
    ]
    return place(source, sheet.data, [rows], placing or ForeignPlacing(), notes, None, machine)


def _readings(sheet: Sheet) -> tuple[list[Reading], str, str | None]:
    """All readings, the layout's name, and the unit that the header tells."""
    line, header = sheet.rows[0]
    names = [split_unit(cell) for cell in header]
    places = {
        role: next((i for i, (name, _) in enumerate(names) if name in words), None)
        for role, words in (
            ("position", _POSITION),
            ("run", _RUN),
            ("direction", _DIRECTION),
            ("deviation", _DEVIATION),
        )
    }
    if places["deviation"] is not None and places["position"] is not None:
        unit = names[places["deviation"]][1]
        return _long(sheet, places), "one reading a row", unit
    numeric = [i for i, cell in enumerate(header) if as_number(cell) is not None]
    if len(numeric) >= 2 and places["direction"] is not None:
        return _by_run(sheet, places, numeric), "one run a row", None
    columns = {i: found for i, cell in enumerate(header) if i and (found := _run_column(cell))}
    if len(columns) == len(header) - 1 and columns:
        return _by_target(sheet, columns), "one target a row", None
    raise InputError(
        "not a table of runs and directions",
        file=sheet.file,
        line=line,
        found=", ".join(header),
        expected="position,run,direction,deviation; or target,1+,1-,2+,2-,…; "
        "or run,direction,0,100,200,…",
    )


def _run_column(heading: str) -> tuple[int, int] | None:
    """Run and direction of a heading such as ``1+``, ``run 2 down``, ``↑3``."""
    match = _RUN_COLUMN.fullmatch(split_unit(heading)[0])
    if match is None:
        return None
    run, word = (match[1], match[2]) if match[1] else (match[4], match[3])
    sense = as_direction(word)
    return None if sense is None else (int(run), sense)


def _long(sheet: Sheet, places: dict[str, int | None]) -> list[Reading]:
    position, deviation = places["position"], places["deviation"]
    run, sense = places["run"], places["direction"]
    header = sheet.rows[0][1]
    if sense is None or position is None or deviation is None:
        raise InputError(
            "a column is missing",
            file=sheet.file,
            line=sheet.rows[0][0],
            field="direction",
            found=", ".join(header),
            expected="a column of directions: up/down, +/-",
        )
    found: list[Reading] = []
    count: dict[tuple[float, int], int] = {}
    for line, cells in sheet.rows[1:]:
        q = number(cells[position], sheet, line, header[position])
        d = direction(cells[sense], sheet, line, header[sense])
        count[q, d] = count.get((q, d), 0) + 1
        j = count[q, d] if run is None else whole(cells[run], sheet, line, header[run])
        found.append((q, j, d, number(cells[deviation], sheet, line, header[deviation]), line))
    return found


def _by_target(sheet: Sheet, columns: dict[int, tuple[int, int]]) -> list[Reading]:
    header = sheet.rows[0][1]
    found: list[Reading] = []
    for line, cells in sheet.rows[1:]:
        q = number(cells[0], sheet, line, header[0])
        for i, (run, sense) in columns.items():
            if cells[i]:
                found.append((q, run, sense, number(cells[i], sheet, line, header[i]), line))
    return found


def _by_run(sheet: Sheet, places: dict[str, int | None], targets: list[int]) -> list[Reading]:
    header = sheet.rows[0][1]
    run, sense = places["run"], places["direction"] or 0
    found: list[Reading] = []
    count = {1: 0, -1: 0}
    for line, cells in sheet.rows[1:]:
        d = direction(cells[sense], sheet, line, header[sense])
        count[d] += 1
        j = count[d] if run is None else whole(cells[run], sheet, line, header[run])
        for i in targets:
            if cells[i]:
                q = number(header[i], sheet, sheet.rows[0][0], header[i])
                found.append((q, j, d, number(cells[i], sheet, line, header[i]), line))
    return found
