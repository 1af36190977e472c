"""The file of a calibrated gauge block or step gauge: a row per face, ``face, at``, mm.

``at`` is where the face is, from the first one. Faces alternate: a step begins with one that looks
back and ends with one that looks ahead; a gauge block is one step, ``1,0`` and ``2,500.00012``. At
the top ``# width = 9`` and ``# height = 35`` (of the steps, mm, across the gauge and along the
stylus), ``# sd = 0.1`` (µm), ``# expansion = 11.5`` (ppm/K).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from abbe.compcore.artefacts.calibrated_gauge import CalibratedGauge
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

_WORDS: Words = {
    "face": ("face", "no", "name"),
    "at": ("at", "place", "position"),
    "width": ("width",),
    "height": ("height",),
    **STANDARD_WORDS,
}
_SECTION = Range(1.0, 500.0, "mm")
_LEAST_STEP = 1.0
"""mm of a step, and between two."""


def read_gauge(path: str | Path) -> CalibratedGauge:
    """Read a calibrated gauge block or step gauge.

    Raises
    ------
    InputError
        Naming file, line, column, what was found and what was expected.
    """
    sheet = read_sheet(Path(path))
    columns = RoleColumns.of(sheet, _WORDS)
    if "at" not in columns.where:
        raise InputError(
            "not a calibrated gauge",
            file=sheet.file,
            line=sheet.rows[0][0],
            found=", ".join(sheet.rows[0][1]),
            expected="face,at, and # width = …, # height = … at the top",
        )
    rows = sheet.rows[1:]
    names = [columns.text(cells, "face", str(i)) for i, (_, cells) in enumerate(rows, start=1)]
    places = np.array([columns.number(line, cells, "at", TRAVEL) for line, cells in rows])
    if len(rows) < 2 or len(rows) % 2:
        raise InputError(
            "a step has two faces", file=sheet.file, field="face",
            found=f"{len(rows)} faces", expected="2, 4, 6, …: every step by both of its faces",
        )  # fmt: skip
    for i in range(len(rows)):
        if names[i] in names[:i]:
            raise InputError(
                "the same face twice", file=sheet.file, line=rows[i][0], field="face",
                found=names[i],
            )  # fmt: skip
        least = 0.0 if i == 0 else places[i - 1] + _LEAST_STEP
        if (i == 0 and places[0] != 0.0) or places[i] < least:
            raise InputError(
                "faces in their order, the first at 0", file=sheet.file, line=rows[i][0],
                field="at", found=f"{places[i]:g}",
                expected="0" if i == 0 else f"{least:g} mm or more",
            )  # fmt: skip
    first = rows[0]
    return CalibratedGauge(
        tuple(names),
        places,
        columns.number(*first, "width", _SECTION),
        columns.number(*first, "height", _SECTION),
        max(calibration_sd(columns, line, cells) for line, cells in rows),
        columns.number(*first, "expansion", EXPANSION, 0.0) * 1e-6,
    )
