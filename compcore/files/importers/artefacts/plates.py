"""Measured ball plates and hole plates: a CSV of a row per ball or hole.

``placing, ball, cx, cy, cz, x, y, z``: calibrated coordinates in the plate's frame, indicated ones
in machine coordinates, mm. Without ``cz`` the plate is one of holes, calibrated in its plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.plate import MeasuredPlate
from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.sheets.roles import (
    EXPANSION,
    STANDARD_TEMPERATURE,
    STANDARD_WORDS,
    TOOL_WORDS,
    RoleColumns,
    Words,
    calibration_sd,
)
from abbe.compcore.files.importers.sheets.words import read_sheet
from abbe.compcore.machine.plausible import TRAVEL
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]

_WORDS: Words = {
    "placing": ("placing", "position", "orientation", "setup"),
    "point": ("ball", "hole", "sphere", "point", "no"),
    **{name: (name,) for name in ("cx", "cy", "cz", "x", "y", "z")},
    **STANDARD_WORDS,
    **TOOL_WORDS,
}
_FEWEST = 3
_FLAT = 1e-6
"""Part of a plate's size below which its points lie on a line."""
_FAR = 1.0
"""mm by which an indicated point may lie beside the placed plate: more is another ball."""


@dataclass(frozen=True, eq=False)
class _PlateRow:
    line: int
    placing: str
    point: str
    calibrated: tuple[float, float, float]
    indicated: tuple[float, float, float]
    sd: float
    expansion: float
    temperature: float | None
    tool: tuple[float, float, float]
    signals: dict[str, float]


def read_plates(
    path: str | Path, *, tool: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[list[MeasuredPlate], bytes]:
    """Read measured plates, one for each placing, and the file's bytes.

    Parameters
    ----------
    tool
        Offset of the probe's tip where the file does not say it, mm.

    Raises
    ------
    InputError
        Naming file, line, column, what was found and what was expected.
    """
    sheet = read_sheet(Path(path))
    columns = RoleColumns.of(sheet, _WORDS)
    if not {"cx", "cy", "x", "y", "z"} <= set(columns.where):
        raise InputError(
            "not a measured plate",
            file=sheet.file,
            line=sheet.rows[0][0],
            found=", ".join(sheet.rows[0][1]),
            expected="placing,ball,cx,cy,cz,x,y,z (without cz: a hole plate)",
        )
    rows: dict[str, list[_PlateRow]] = {}
    for i, (line, cells) in enumerate(sheet.rows[1:], start=1):
        row = _row(columns, line, cells, str(i), tool)
        rows.setdefault(row.placing, []).append(row)
    planar = "cz" not in columns.where
    return [_plate(sheet.file, own, planar) for own in rows.values()], sheet.data


def _row(
    columns: RoleColumns,
    line: int,
    cells: list[str],
    number: str,
    tool: tuple[float, float, float],
) -> _PlateRow:
    def at(*roles: str) -> tuple[float, float, float]:
        x, y, z = (
            0.0 if r == "cz" and r not in columns.where else columns.number(line, cells, r, TRAVEL)
            for r in roles
        )
        return x, y, z

    temperature = None
    if columns.states("temperature"):
        temperature = columns.number(line, cells, "temperature", STANDARD_TEMPERATURE)
    return _PlateRow(
        line,
        columns.text(cells, "placing", "1"),
        columns.text(cells, "point", number),
        at("cx", "cy", "cz"),
        at("x", "y", "z"),
        calibration_sd(columns, line, cells),
        columns.number(line, cells, "expansion", EXPANSION, 0.0) * 1e-6,
        temperature,
        columns.tool(line, cells, tool),
        columns.signals(line, cells),
    )


def _plate(file: str, rows: list[_PlateRow], planar: bool) -> MeasuredPlate:
    calibrated = np.array([r.calibrated for r in rows])
    size = np.linalg.svd(calibrated - calibrated.mean(axis=0), compute_uv=False)
    if len(rows) < _FEWEST or size[1] <= _FLAT * size[0]:
        raise InputError(
            "a plate needs three points that are not on one line",
            file=file,
            line=rows[0].line,
            field="ball",
            found=f"{len(rows)} in placing {rows[0].placing}",
        )
    known = [r.temperature for r in rows if r.temperature is not None]
    plate = MeasuredPlate(
        rows[0].placing,
        tuple(r.point for r in rows),
        calibrated,
        planar,
        np.array([r.indicated for r in rows]),
        max(r.sd for r in rows),
        rows[0].expansion,
        np.array(known) if known else None,
        np.array([r.tool for r in rows]),
        {name: np.array([r.signals[name] for r in rows]) for name in rows[0].signals},
        np.array([r.line for r in rows], dtype=np.int64),
    )
    beside = np.linalg.norm(plate.errors(), axis=1)
    if beside.max() > _FAR:
        worst = int(np.argmax(beside))
        raise InputError(
            "not where the plate would have it",
            file=file,
            line=rows[worst].line,
            field="x, y, z",
            found=f"{in_digits(beside[worst])} mm beside",
            expected="the same ball in both frames, both right-handed, mm",
        )
    return plate
