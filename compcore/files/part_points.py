"""A part program as a table: a row per touched point, ``feature,kind,x,y,z,nx,ny,nz``."""

from __future__ import annotations

import csv
import math
from typing import Any, get_args

from abbe.compcore.errors import InputError
from abbe.compcore.files.formats import PART
from abbe.compcore.virtual_cmm.features import ElementKind

MOST_POINTS = 2000
"""Touched points of a part program, of all its features."""
COLUMNS = ("feature", "kind", "x", "y", "z", "nx", "ny", "nz")


def csv_document(text: str, file: str | None) -> tuple[str, list[dict[str, Any]], dict[int, int]]:
    """Split a table of points.

    Returns
    -------
    head
        The lines behind ``#`` as TOML.
    features
        As ``[[features]]`` would hold them.
    lines
        Number of a feature → the line of its first point.

    Raises
    ------
    InputError
        Naming line and column of what is no table of points.
    """
    head, rows, header = [], [], 0
    for number, line in enumerate(text.splitlines(), start=1):
        bare = line.strip()
        if bare.startswith('"#'):
            # a spreadsheet put the cell into quotes, and doubled those inside
            bare = bare.rstrip(",").strip('"').replace('""', '"')
        if bare.startswith("#") and not header:
            head.append(bare.removeprefix("#").removeprefix(" "))
        elif line.strip():
            header = header or number
            rows.append((number, line))
            head.append("")
        else:
            head.append("")
    if not any(line.strip().startswith("format") for line in head):
        raise InputError(
            "the head lacks its format", file=file, line=1, field="format",
            expected=f'# format = "{PART}"',
        )  # fmt: skip
    names = [name.strip() for name in next(csv.reader([rows[0][1]]))]
    for name in COLUMNS:
        if names.count(name) != 1:
            raise InputError(
                "a column is missing or stands twice", file=file, line=rows[0][0], field=name,
                found=", ".join(names), expected=",".join(COLUMNS),
            )  # fmt: skip
    for name in names:
        if name not in (*COLUMNS, "stylus"):
            raise InputError(
                "no such column", file=file, line=rows[0][0], field=name, found=name,
                expected=",".join(COLUMNS) + " and perhaps stylus",
            )  # fmt: skip
    if len(rows) - 1 > MOST_POINTS:
        raise InputError(
            "too many points", file=file, line=rows[MOST_POINTS + 1][0], field="points",
            found=len(rows) - 1, expected=f"{MOST_POINTS} or fewer of all features",
        )  # fmt: skip
    features: dict[str, dict[str, Any]] = {}
    lines: dict[int, int] = {}
    for number, line in rows[1:]:
        cells = dict(zip(names, _cells(line, number, len(names), file), strict=True))
        name = cells["feature"]
        if cells["kind"] not in get_args(ElementKind):
            raise InputError(
                "no such kind of feature", file=file, line=number, field="kind",
                found=cells["kind"], expected="one of " + ", ".join(get_args(ElementKind)),
            )  # fmt: skip
        if name not in features:
            lines[len(features)] = number
            features[name] = {
                "name": name, "kind": cells["kind"], "stylus": cells.get("stylus", ""),
                "points": [], "normals": [],
            }  # fmt: skip
        mine = features[name]
        for key in ("kind", "stylus"):
            if cells.get(key, "") != mine[key]:
                raise InputError(
                    f"a feature has one {key}", file=file, line=number, field=key,
                    found=cells.get(key), expected=mine[key],
                )  # fmt: skip
        mine["points"].append([_number(cells, key, number, file) for key in ("x", "y", "z")])
        normal = [_number(cells, key, number, file) for key in ("nx", "ny", "nz")]
        if not any(normal):
            raise InputError(
                "not a direction", file=file, line=number, field="nx, ny, nz", found="0, 0, 0",
                expected="the direction out of the material",
            )  # fmt: skip
        mine["normals"].append(normal)
    return "\n".join(head), list(features.values()), lines


def _cells(line: str, number: int, wanted: int, file: str | None) -> list[str]:
    try:
        (cells,) = csv.reader([line])
    except csv.Error as error:
        raise InputError(f"not a row of a table: {error}", file=file, line=number) from None
    if len(cells) != wanted:
        raise InputError(
            "not a cell for each column", file=file, line=number, found=len(cells),
            expected=f"{wanted} cells",
        )  # fmt: skip
    return [cell.strip() for cell in cells]


def _number(cells: dict[str, str], key: str, line: int, file: str | None) -> float:
    try:
        number = float(cells[key])
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(
            "not a number", file=file, line=line, field=key, found=cells[key],
            expected="a number, mm; directions without unit",
        )  # fmt: skip
    return number
