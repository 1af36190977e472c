"""Circular tests with a ball bar to a campaign.

CSV, two layouts: ``angle, deviation, direction`` (a row per reading, ``ccw`` or ``cw``), or
``angle, ccw, cw`` (a column per direction). Angles in degrees from the plane's first axis towards
its second; deviations of the radius in µm. Centre, radius and plane in ``# key = value`` lines at
the top or given by the caller.

The deviation is the component of the functional point's error along the radius, outward:
measured radius minus nominal. Where the ball bar's centre really stood (``frame``) and its
calibrated length (``zero``) are left free.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.placing import I64, ForeignPlacing, Readings, place
from abbe.compcore.files.importers.sheets.words import (
    Sheet,
    as_number,
    direction,
    number,
    read_sheet,
    scale_of,
    split_unit,
    unit_of,
)
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.plausible import TRAVEL, TRAVEL_ROTARY

PLANES: Mapping[str, tuple[str, str]] = {"XY": ("X", "Y"), "YZ": ("Y", "Z"), "ZX": ("Z", "X")}
_ANGLE = ("angle", "theta", "phi")
_DEVIATION = ("deviation", "radius_deviation", "radial_deviation", "error", "value", "dr")
_DIRECTION = ("direction", "dir")
_STANDS = 1e-9


def import_ballbar(
    path: str | Path,
    placing: ForeignPlacing | None = None,
    *,
    plane: str | None = None,
    centre: tuple[float, float] | None = None,
    radius: float | None = None,
    unit: str | None = None,
    machine: Machine | None = None,
) -> Campaign:
    """Read a circular test.

    Parameters
    ----------
    plane
        ``XY``, ``YZ`` or ``ZX``; where None, the file's ``# plane = XY``.
    centre
        Of the circle in that plane, mm; where None, the file's ``# centre = 350, 450``.
    radius
        Nominal radius, mm; where None, the file's ``# radius = 100``.
    unit
        Unit of the deviations; where None the header's, else µm.

    Raises
    ------
    InputError
        Naming file, line, what was found and what was expected.
    """
    source = Path(path)
    placing = placing or ForeignPlacing()
    sheet = read_sheet(source)
    first, second = _plane(plane or sheet.comments.get("plane"), sheet)
    middle = centre or _centre(sheet)
    size = radius if radius is not None else _said(sheet, "radius", "the nominal radius, mm")
    angle, sense, deviation, line, stated = _readings(sheet)
    unit = unit_of(unit, stated, deviation.tolist(), sheet.file, rotation=False)
    value = deviation * scale_of(unit, "mm", sheet.file)
    theta = np.deg2rad(angle)
    outward = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    tangent = np.stack([-np.sin(theta), np.cos(theta)], axis=1) * sense[:, None]
    u = np.zeros((len(value), 3))
    u[:, "XYZ".index(first)], u[:, "XYZ".index(second)] = outward.T
    readings = Readings(
        positions={
            first: middle[0] + size * outward[:, 0],
            second: middle[1] + size * outward[:, 1],
        },
        directions={first: _sign(tangent[:, 0]), second: _sign(tangent[:, 1])},
        kind=Kind.DISPLACEMENT,
        value=value,
        u=u,
        free=("zero", "frame"),
        line=line,
    )
    minus = "−(" if placing.sign < 0 else ""
    notes = [
        f"imported from {source.name} (ball bar)",
        f"sign: error outward along the radius = {minus}measured − nominal radius"
        + (")" if minus else ""),
        f"plane {first}{second}, centre {middle[0]:g}, {middle[1]:g} mm, radius {size:g} mm",
        f"deviations in {unit}",
        "the file has no times",
    ]
    metadata = {"instrument": "ball bar"}
    return place(source, sheet.data, [readings], placing, notes, metadata, machine)


def _sign(slope: np.ndarray) -> I64:
    """Direction of motion; 0 at the points where the axis turns round."""
    return np.where(np.abs(slope) < _STANDS, 0.0, np.sign(slope)).astype(np.int64)


def _plane(text: str | None, sheet: Sheet) -> tuple[str, str]:
    name = (text or "").upper()
    if name not in PLANES:
        raise InputError(
            "the plane is not known" if text is None else "no such plane",
            file=sheet.file,
            field="plane",
            found=text,
            expected="XY, YZ or ZX (--plane, or a line # plane = XY)",
        )
    return PLANES[name]


def _centre(sheet: Sheet) -> tuple[float, float]:
    text = sheet.comments.get("centre", sheet.comments.get("center", ""))
    numbers = [as_number(word) for word in text.strip("[]()").replace(";", ",").split(",")]
    if len(numbers) != 2 or not all(n is not None and TRAVEL.holds(n) for n in numbers):
        raise InputError(
            "the centre is not known" if not text else "not a point of the plane",
            file=sheet.file,
            field="centre",
            found=text or None,
            expected="two coordinates in mm (--centre, or a line # centre = 350, 450)",
        )
    first, second = (n for n in numbers if n is not None)
    return first, second


def _said(sheet: Sheet, key: str, what: str) -> float:
    text = sheet.comments.get(key)
    value = None if text is None else as_number(text)
    if value is None or not 0.0 < value <= TRAVEL.high:
        raise InputError(
            f"the {key} is not known" if text is None else f"not a {key}",
            file=sheet.file,
            field=key,
            found=text,
            expected=f"{what} (--{key}, or a line # {key} = 100)",
        )
    return value


def _readings(sheet: Sheet) -> tuple[np.ndarray, I64, np.ndarray, I64, str | None]:
    line, header = sheet.rows[0]
    names = [split_unit(cell) for cell in header]
    where = {name: i for i, (name, _) in enumerate(names)}
    angle = next((where[n] for n in _ANGLE if n in where), None)
    deviation = next((where[n] for n in _DEVIATION if n in where), None)
    sense = next((where[n] for n in _DIRECTION if n in where), None)
    both = [(where[n], d) for n, d in (("ccw", 1), ("cw", -1)) if n in where]
    if angle is None or (not both and (deviation is None or sense is None)):
        raise InputError(
            "not a circular test",
            file=sheet.file,
            line=line,
            found=", ".join(header),
            expected="angle,deviation,direction; or angle,ccw,cw",
        )
    found: list[tuple[float, int, float, int]] = []
    for line, cells in sheet.rows[1:]:
        at = number(cells[angle], sheet, line, header[angle])
        if not TRAVEL_ROTARY.holds(at):
            raise InputError(
                "not believable",
                file=sheet.file,
                line=line,
                field=header[angle],
                found=cells[angle],
                expected=str(TRAVEL_ROTARY),
            )
        if both:
            found += [
                (at, d, number(cells[i], sheet, line, header[i]), line) for i, d in both if cells[i]
            ]
        elif deviation is not None and sense is not None:
            d = direction(cells[sense], sheet, line, header[sense])
            found.append((at, d, number(cells[deviation], sheet, line, header[deviation]), line))
    unit = names[both[0][0] if both else deviation or 0][1]
    angles, senses, values, lines = zip(*found, strict=True)
    return np.array(angles), np.array(senses), np.array(values), np.array(lines), unit
