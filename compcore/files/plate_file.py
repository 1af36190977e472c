"""The file of a calibrated ball plate: a row per ball, ``ball, cx, cy, cz``, mm.

At its top, or in columns, as in files of measured plates: ``# diameter = 22`` (of the balls, mm),
``# sd = 0.3`` (µm), ``# expansion = 11.5`` (ppm/K). The frame is the plate's own; the balls are
touched from the side to which its z points.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from abbe.compcore.artefacts.calibrated_plate import CalibratedPlate
from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.sheets.roles import (
    EXPANSION,
    STANDARD_WORDS,
    RoleColumns,
    Words,
    calibration_sd,
)
from abbe.compcore.files.importers.sheets.words import read_sheet
from abbe.compcore.machine.plausible import TRAVEL, Range
from abbe.compcore.planning.probing.touches import farthest_three

_WORDS: Words = {
    "point": ("ball", "sphere", "point", "no"),
    "diameter": ("diameter", "d"),
    **{name: (name,) for name in ("cx", "cy", "cz")},
    **STANDARD_WORDS,
}
_DIAMETER = Range(0.5, 500.0, "mm")
_FEWEST = 3


def read_plate(path: str | Path) -> CalibratedPlate:
    """Read a calibrated ball plate.

    Raises
    ------
    InputError
        Naming file, line, column, what was found and what was expected.
    """
    sheet = read_sheet(Path(path))
    columns = RoleColumns.of(sheet, _WORDS)
    if not {"cx", "cy", "cz"} <= set(columns.where):
        raise InputError(
            "not a calibrated ball plate",
            file=sheet.file,
            line=sheet.rows[0][0],
            found=", ".join(sheet.rows[0][1]),
            expected="ball,cx,cy,cz, and # diameter = … at the top",
        )
    rows = sheet.rows[1:]
    names = [columns.text(cells, "point", str(i)) for i, (_, cells) in enumerate(rows, start=1)]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise InputError(
                "the same ball twice", file=sheet.file, line=rows[i][0], field="ball", found=name
            )
    at = [
        [columns.number(line, cells, k, TRAVEL) for k in ("cx", "cy", "cz")] for line, cells in rows
    ]
    sizes = [columns.number(line, cells, "diameter", _DIAMETER) for line, cells in rows]
    if len(set(sizes)) > 1:
        raise InputError(
            "balls of several diameters", file=sheet.file, field="diameter",
            found=", ".join(f"{d:g}" for d in sorted(set(sizes))[:3]), expected="one diameter",
        )  # fmt: skip
    places = np.array(at, dtype=np.float64).reshape(-1, 3)
    try:
        if len(rows) < _FEWEST:
            raise ValueError(f"{len(rows)} balls")
        farthest_three(places)
    except ValueError as error:
        raise InputError(
            "a plate needs three balls that are not on one line", file=sheet.file, field="ball",
            found=str(error),
        ) from None  # fmt: skip
    return CalibratedPlate(
        tuple(names),
        places,
        sizes[0],
        max(calibration_sd(columns, line, cells) for line, cells in rows),
        columns.number(*rows[0], "expansion", EXPANSION, 0.0) * 1e-6,
    )
