"""Touches of a sphere on the table by the machine's own probe to a campaign.

CSV, a row a touch: every axis by its name, mm and degrees, where the machine stood when it touched.
Touches one after the other with the rotary axes at the same angles are one sphere: five or more.
Each becomes an R-test's row: the tool, as indicated, beside the sphere, which stays where it is.
"""

from __future__ import annotations

import re
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.sphere import FEWEST, FittedSphere, fit_sphere
from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.campaign.measuring_conditions import stated
from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.placing import ForeignPlacing, Readings, place, read_bytes
from abbe.compcore.files.importers.sheets.roles import TOOL_WORDS, RoleColumns
from abbe.compcore.files.importers.sheets.words import Sheet, read_sheet
from abbe.compcore.files.text.encodings import decoded
from abbe.compcore.iso10791.poses import following
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.plausible import position_range

F64 = NDArray[np.float64]

_WORD = re.compile(r"([A-Z])\s*([-+]?)\s*(\d*\.\d+)")
_ROW = re.compile(rf"(?:{_WORD.pattern}\s*)+")
_SAME_SPHERE = 0.1
"""mm by which touches may lie beside a sphere, and radii of one sphere differ."""


def import_probed(
    path: str | Path, machine: Machine, placing: ForeignPlacing | None = None
) -> Campaign:
    """Read touches of one sphere; one set-up, where the sphere really is left free.

    Raises
    ------
    InputError
        Naming file, line, column, what was found and what was expected.
    """
    source = Path(path)
    placing = placing or ForeignPlacing()
    sheet = _of_words(source) or read_sheet(source)
    axes, rotary = machine.structure.axes, machine.structure.rotary
    columns = RoleColumns.of(sheet, {a: (a.lower(),) for a in axes} | dict(TOOL_WORDS))
    missing = [a for a in axes if a not in columns.where]
    if missing or not rotary:
        raise InputError(
            "not the touches of a sphere on a machine with rotary axes",
            file=sheet.file,
            line=sheet.rows[0][0],
            found=", ".join(sheet.rows[0][1]),
            expected="columns " + ", ".join(axes) + " and a machine with rotary axes",
        )
    rows = sheet.rows[1:]
    read = {
        a: np.array([columns.number(n, c, a, position_range(machine.axes[a])) for n, c in rows])
        for a in axes
    }
    angles = [tuple(round(float(read[a][i]), 3) for a in rotary) for i in range(len(rows))]
    groups = [list(own) for _, own in groupby(range(len(rows)), key=lambda i: angles[i])]
    touched = np.stack([read[a] for a in "XYZ"], axis=1)
    spheres = [_sphere(sheet.file, [rows[i][0] for i in own], touched[own]) for own in groups]
    first = np.array([own[0] for own in groups], dtype=np.int64)
    radius = float(np.median([s.radius for s in spheres]))
    for sphere, i in zip(spheres, first, strict=True):
        if abs(sphere.radius - radius) > _SAME_SPHERE:
            raise InputError(
                "another sphere", file=sheet.file, line=rows[i][0], field="X, Y, Z",
                found=f"radius {sphere.radius:.3f} mm",
                expected=f"{radius:.3f} mm, as the others (with the tip's)",
            )  # fmt: skip
    positions = {
        a: np.deg2rad(read[a][first]) if a in rotary else read[a][first].astype(np.float64)
        for a in axes
    }
    for k, a in enumerate("XYZ"):
        positions[a] = np.array([s.centre[k] for s in spheres])
    tool = np.array([columns.tool(rows[i][0], rows[i][1], placing.tool) for i in first])
    chain = Chain(machine, Conditions(positions, tool=tool))
    # the sphere does not move on the table; where it is exactly, the free frame says
    middle = chain.point.mean(axis=0)
    error = chain.to_machine_axes(middle - chain.point)
    # where the controller has it: at places that are off by the errors, a frame that turns about
    # the sphere itself would seem to explain them
    still = {a: q for a, q in positions.items() if a not in "XYZ"}
    positions = following(machine, still, np.tile(middle, (len(groups), 1)), tool)
    recorded = [columns.signals(rows[i][0], rows[i][1]) for i in first]
    n = len(groups)
    readings = [
        Readings(
            positions,
            {a: np.zeros(n, dtype=np.int64) for a in axes},
            Kind.DISPLACEMENT,
            error[:, k],
            np.tile(u, (n, 1)),
            ("frame",),
            np.array([rows[i][0] for i in first], dtype=np.int64),
            signals={name: np.array([r[name] for r in recorded]) for name in columns.others},
            sd=np.array([np.hypot(placing.sd or 0.0, s.sd(u)) or 1e-6 for s in spheres]),
            tool=tool,
        )
        for k, u in enumerate(np.eye(3))
    ]
    form = max(s.form for s in spheres) * 1e3
    notes = [
        f"imported from {source.name} ({n} spheres touched, {len(rows)} touches)",
        "sign: error = sphere, which stays on the table, − tool as indicated",
        f"middles by least squares; worst form deviation {form:.2f} µm, radius {radius:.4f} mm",
    ]
    metadata = {"instrument": "sphere and touch probe", **stated(sheet.comments)}
    return place(source, sheet.data, readings, placing, notes, metadata, machine)


def _of_words(path: Path) -> Sheet | None:
    """A file of rows ``X 193.0021 Y -40.0003 C 30.0000``, as a control prints; None: it is none."""
    data = read_bytes(path)
    rows: list[tuple[int, list[str]]] = []
    for at, line in enumerate(decoded(data).splitlines(), start=1):
        # a control may put marks of its own before and behind what it prints
        text = "".join(c for c in line if c.isprintable()).strip()
        if not text or text == "%":
            continue
        if not _ROW.fullmatch(text):
            return None
        words = _WORD.findall(text)
        rows = rows or [(at, [axis for axis, _, _ in words])]
        rows.append((at, [sign + size for _, sign, size in words]))
    return Sheet(str(path), rows, {}, data) if rows else None


def _sphere(file: str, lines: list[int], points: F64) -> FittedSphere:
    try:
        found = fit_sphere(points)
    except ValueError as error:
        raise InputError(
            "no sphere", file=file, line=lines[0], field="X, Y, Z", found=str(error),
            expected=f"{FEWEST} touches or more all round, one after the other, rotary axes still",
        ) from None  # fmt: skip
    if found.form > _SAME_SPHERE:
        raise InputError(
            "touches that are not on one sphere", file=file, line=lines[0], field="X, Y, Z",
            found=f"form deviation {found.form:.3f} mm", expected=f"at most {_SAME_SPHERE} mm",
        )  # fmt: skip
    return found
