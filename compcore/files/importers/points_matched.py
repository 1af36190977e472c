"""A tracker's points matched with the poses that a machine was followed to: visit by visit.

The tracker's own software writes ``x, y, z`` in its own frame (or its ``distance``), one line for
each reading, in the order in which they were read. Where the axes stood at each, from which side
they had come, when, and how warm it was, says who followed the machine. How the tracker stands is
found from the points. The reflector sits where the plan has it: what is wrong with that shows as
`spindle_location`, unless it is mm. Points in another order than the poses are refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.lines.matched import Row, write_rows
from abbe.compcore.files.importers.sheets.logged import columns_of, numbers_of
from abbe.compcore.files.importers.sheets.words import read_sheet, scale_of
from abbe.compcore.files.importers.tracker import COLUMNS, FITS, stand
from abbe.compcore.files.visited_targets import VisitedTargets
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]

DISTANCE = ("distance", "d", "range")
"""What the column of an interferometer's distances may be called."""
_UNIT_VECTOR, _TOOL = ("ux", "uy", "uz"), ("tool_x", "tool_y", "tool_z")
_ELSEWHERE = 3.0
"""mm by which a reflector's offset is a mistake; less is an error of the machine as any other."""
_SHOWN_BY = 2
"""Rotary axes that have to turn: about one line alone a shift of the reflector looks like one of
the tracker."""
_NEAR = 5.0
"""mm by which a distance may be off what the plan's stand says, all by the same apart."""
_NAMED = 4
"""Such readings that are named."""
_APART = 8.0
"""Times as far off as half of the readings are at which one is of another pose, or was lost."""


def reads_points(visits: VisitedTargets) -> bool:
    """Whether a set-up reads X, Y, Z at every pose, or distances: what a tracker's file holds."""
    first = visits.rows[0]
    if first["kind"] == "distance":
        return True
    return first["kind"] == "displacement" and len(_directions(visits)) == len(_UNIT_VECTOR)


def write_points(
    matched: Sequence[tuple[Path, VisitedTargets]], machine: Machine, out: Path, unit: str = "mm"
) -> tuple[int, tuple[str, ...]]:
    """Write the campaign of all set-ups, each with its file of points; how many rows, and notes.

    Raises
    ------
    InputError
        Naming file, what was found and what was expected, where the two do not fit.
    """
    seen = [_seen(file, visits, unit) for file, visits in matched]
    notes = ["readings of a tracker, matched in the order of the visits"]
    tools: dict[tuple[float, ...], F64] = {}
    # where most of the axes turn it is seen best, and it counts for all set-ups of that tool
    for k in sorted(range(len(matched)), key=lambda k: -_turning(matched[k][1])):
        visits, tool = matched[k][1], _tool(matched[k][1])
        if seen[k].shape[1] < len(_UNIT_VECTOR) or tool in tools or _turning(visits) < _SHOWN_BY:
            continue
        pose = stand(_chain(visits, machine), seen[k], np.array(tool), free=True)
        tools[tool] = np.array(tool)
        if float(np.linalg.norm(pose.tool - np.array(tool))) > _ELSEWHERE:
            tools[tool] = np.round(pose.tool, 3)
            words = ", ".join(f"{v:g}" for v in tools[tool].tolist())
            notes.append(f"the reflector is not where the plan has it: {words} mm is taken")
    done: list[tuple[VisitedTargets, list[Row]]] = []
    for (file, visits), points in zip(matched, seen, strict=True):
        offset = tools.get(_tool(visits), np.array(_tool(visits)))
        if points.shape[1] == 1:
            _check_distances(file, visits, machine, offset, points[:, 0])
            values = points
        else:
            values = _errors(file, visits, machine, offset, points)
        placed = dict(zip(_TOOL, offset.tolist(), strict=True))
        flat = values.reshape(-1).tolist()
        rows: list[Row] = [
            {**row, **placed, "value": v} for row, v in zip(visits.rows, flat, strict=True)
        ]
        done.append((visits, rows))
    return write_rows(done, out, "; ".join(notes)), tuple(notes)


def _seen(file: Path, visits: VisitedTargets, unit: str) -> F64:
    """The readings of a file, (visits, 3) or (visits, 1), mm."""
    sheet = read_sheet(file)
    columns = columns_of(sheet)
    apart = visits.rows[0]["kind"] == "distance"
    asked = [(name,) for name in DISTANCE] if apart else [*COLUMNS]
    names = next((n for n in asked if set(n) <= set(columns)), None)
    if names is None:
        raise InputError(
            f"no columns of what {visits.setup} reads",
            file=file,
            found=", ".join(columns),
            expected="a column distance" if apart else "columns x, y, z in the tracker's frame",
        )
    seen = np.stack([numbers_of(columns[c], sheet) for c in names], axis=1)
    count = len(visits.rows) if apart else len(visits.rows) // len(_UNIT_VECTOR)
    if len(seen) != count:
        raise InputError(
            f"{len(seen)} readings, and the machine stood at {count} poses of {visits.setup}",
            file=file,
            expected="one for each pose, in their order, those read again as often",
        )
    return seen * scale_of(unit, "mm", sheet.file)


def _directions(visits: VisitedTargets) -> list[tuple[float, ...]]:
    """The directions read at the first pose: rows that agree in when and where."""
    first = visits.rows[0]
    own = [row for row in visits.rows[: len(_UNIT_VECTOR)] if row["time"] == first["time"]]
    return [tuple(float(row[name]) for name in _UNIT_VECTOR) for row in own]


def _tool(visits: VisitedTargets) -> tuple[float, float, float]:
    x, y, z = (float(visits.rows[0][name]) for name in _TOOL)
    return x, y, z


def _axes(visits: VisitedTargets) -> list[str]:
    return [c.removesuffix("_dir") for c in visits.columns if c.endswith("_dir")]


def _turning(visits: VisitedTargets) -> int:
    """How many rotary axes turn in a set-up."""
    axes = [a for a in _axes(visits) if is_rotary(a)]
    return sum(len({round(float(row[a]), 2) for row in visits.rows}) > 1 for a in axes)


def _chain(visits: VisitedTargets, machine: Machine) -> Chain:
    """The machine at each visit."""
    step = 1 if visits.rows[0]["kind"] == "distance" else len(_UNIT_VECTOR)
    rows = visits.rows[::step]
    at = {}
    for axis in machine.structure.axes:
        if axis not in rows[0]:
            raise InputError(
                f"where axis {axis} stood is not stated", file=visits.path, field=axis,
                expected="targets that were followed on this machine",
            )  # fmt: skip
        q = np.array([float(row[axis]) for row in rows])
        at[axis] = np.radians(q) if is_rotary(axis) else q
    return Chain(machine, Conditions(at, tool=np.tile(_tool(visits), (len(rows), 1))))


def _errors(file: Path, visits: VisitedTargets, machine: Machine, offset: F64, seen: F64) -> F64:
    """Point less where the machine as modelled is, along each row's direction, (visits, 3), µm."""
    chain = _chain(visits, machine).with_tool(np.tile(offset, (len(seen), 1)))
    pose = stand(chain, seen, offset, free=False)
    spread = float(np.sqrt(np.mean(np.ptp(seen, axis=0) ** 2)))
    if pose.rms > FITS * spread:
        worst = int(np.argmax(np.linalg.norm(pose.left, axis=1)))
        raise InputError(
            f"the points are not those of the poses of {visits.setup}",
            file=file,
            found=f"{pose.rms:.3g} mm rms left over {spread:.3g} mm, most at reading {worst + 1}",
            expected="one point for each pose, in their order; the unit, each axis's sense and "
            "zero, where its line lies (location)",
        )
    _require_alike(file, visits, np.linalg.norm(pose.left, axis=1))
    u = np.array([[float(row[name]) for name in _UNIT_VECTOR] for row in visits.rows])
    error = np.repeat(chain.to_machine_axes(pose.left), len(_UNIT_VECTOR), axis=0)
    value = np.round(1e3 * np.einsum("ij,ij->i", error, u), 4)
    return np.asarray(value.reshape(len(seen), -1))


def _check_distances(
    file: Path, visits: VisitedTargets, machine: Machine, offset: F64, seen: F64
) -> None:
    """Refuse distances that do not change as those to the plan's stand do."""
    chain = _chain(visits, machine).with_tool(np.tile(offset, (len(seen), 1)))
    base = visits.head.get("bases", {}).get(visits.rows[0]["base"], {}).get("position")
    if base is None:
        return
    away = chain.point - np.asarray(base)
    expected = np.linalg.norm(away, axis=1)
    # the interferometer stands somewhat elsewhere, and counts from any zero
    design = np.column_stack([away / expected[:, None], np.ones(len(seen))])
    left = seen - expected - design @ np.linalg.lstsq(design, seen - expected, rcond=None)[0]
    if float(np.sqrt(np.mean(left**2))) > max(_NEAR, FITS * float(np.ptp(expected))):
        raise InputError(
            f"the distances are not those of the poses of {visits.setup}",
            file=file,
            found=f"{np.sqrt(np.mean(left**2)):.3g} mm rms left",
            expected="one for each pose, in their order, in mm",
        )
    _require_alike(file, visits, np.abs(left))


def _require_alike(file: Path, visits: VisitedTargets, off: F64) -> None:
    """Refuse single readings that are far beyond all others: two exchanged, a beam that was lost.

    Parameters
    ----------
    off
        How far each reading is from where the machine as modelled is, (visits,), mm.
    """
    far = np.flatnonzero(off > max(_ELSEWHERE, _APART * float(np.median(off))))
    if not far.size:
        return
    named = [f"reading {k + 1} ({off[k]:.3g} mm)" for k in far[:_NAMED].tolist()]
    raise InputError(
        f"single readings are not those of their poses of {visits.setup}: half of all are within "
        f"{float(np.median(off)):.3g} mm",
        file=file,
        found=", ".join(named) + (" …" if far.size > _NAMED else ""),
        expected="each pose's own: are two lines exchanged, was the beam lost?",
    )
