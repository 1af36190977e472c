"""Readings of a file matched, by target and side, with the targets that a machine was followed to.

The file says what was read at which target of which run; who followed the machine says where it
stood then, from which side it had come, when, and how warm it was. Nothing is guessed: every target
has to be there as often as it was read.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.errors import InputError
from abbe.compcore.files.campaign_csv.head import BEGUN
from abbe.compcore.files.campaign_csv.writing import as_cell
from abbe.compcore.files.growing_campaign import top_of
from abbe.compcore.files.text.atomic import write_atomically
from abbe.compcore.files.visited_targets import READINGS, VisitedTargets
from abbe.compcore.machine.machine import nominal_direction
from abbe.compcore.machine.structure import is_rotary

_WITHIN, _WITHIN_TURN = 0.5, 0.1
"""mm and degrees by which a machine may stand off a target of the file."""
_ALONG = 1e-6
"""By which two directions may differ."""
Row = dict[str, str | float | None]
"""A row of a campaign: column → cell."""
_Place = tuple[int, float]


def write_matched(readings: Campaign, visits: VisitedTargets, out: Path, notes: str) -> int:
    """Write the visited targets with the readings of a file; how many.

    Parameters
    ----------
    readings
        The file as its importer reads it.
    notes
        What the importer assumed, for the head.

    Raises
    ------
    InputError
        Where the two do not fit, by target.
    """
    return write_all_matched([(readings, visits)], out, notes)


def write_all_matched(
    matched: Sequence[tuple[Campaign, VisitedTargets]], out: Path, notes: str
) -> int:
    """Write the visited targets of several set-ups with the readings of a file each; how many.

    All were followed in one measurement; parameters and errors as of `write_matched`.
    """
    return write_rows([(visits, _with_values(one, visits)) for one, visits in matched], out, notes)


def write_rows(
    matched: Sequence[tuple[VisitedTargets, Sequence[Row]]], out: Path, notes: str
) -> int:
    """Write the rows of several set-ups that were followed in one measurement; how many."""
    numbered = [
        (line, row)
        for visits, valued in matched
        for line, row in zip(visits.lines, valued, strict=True)
    ]
    rows = [row for _, row in sorted(numbered, key=lambda found: found[0])]
    first = matched[0][0]
    begun = {k: v for k, v in first.head[BEGUN].items() if k != READINGS}
    head = {**first.head, BEGUN: begun, "notes": notes}
    stated = first.head.get("setups", {})
    head["setups"] = {visits.setup: stated.get(visits.setup, {}) for visits, _ in matched}
    lines = [",".join(as_cell(row[name]) for name in first.columns) + "\n" for row in rows]
    write_atomically(out, top_of(head, first.columns) + "".join(lines))
    return len(rows)


def _with_values(readings: Campaign, visits: VisitedTargets) -> list[Row]:
    """The rows of a set-up, each with its reading."""
    axis = moving(visits)
    if len(set(visits.columns)) != len(visits.columns) or axis not in readings.conditions.positions:
        raise InputError(
            "the file is of another axis",
            file=readings.name,
            found=", ".join(readings.conditions.positions),
            expected=f"{axis}, which moved in {visits.setup}",
        )
    values = dict(_paired(readings, visits, axis))
    return [{**row, "value": values[i]} for i, row in enumerate(visits.rows)]


def _paired(readings: Campaign, visits: VisitedTargets, axis: str) -> Iterator[tuple[int, float]]:
    """Row of the visits → its value, µm or µrad."""
    rotary, c = is_rotary(axis), readings.conditions
    at = np.degrees(c.positions[axis]) if rotary else c.positions[axis]
    came = c.directions.get(axis, np.zeros(readings.n))
    targets = np.unique(np.round(at, 6))
    read: dict[_Place, list[int]] = defaultdict(list)
    for i in range(readings.n):
        read[int(np.argmin(np.abs(targets - at[i]))), float(came[i])].append(i)
    stood: dict[_Place, list[int]] = defaultdict(list)
    for i, row in enumerate(visits.rows):
        place = float(row[axis])
        nearest = int(np.argmin(np.abs(targets - place)))
        if abs(targets[nearest] - place) > (_WITHIN_TURN if rotary else _WITHIN):
            raise InputError(
                f"the file has no target where the machine stood, {axis} {place:.3f}",
                file=visits.path,
                line=visits.lines[i],
                found=f"the nearest is {targets[nearest]:g}",
            )
        stood[nearest, float(row[f"{axis}_dir"] or 0.0)].append(i)
    for target, sense in sorted({*read, *stood}):
        found, times = len(read[target, sense]), len(stood[target, sense])
        if found != times:
            side = {1.0: "from below", -1.0: "from above"}.get(sense, "from an unknown side")
            raise InputError(
                f"target {axis} {targets[target]:g} {side}: the file has {found} readings, the "
                f"machine stood there {times} times",
                file=readings.name,
                expected="each reading with its target, in the same runs",
            )
    for key, own in stood.items():
        for i, k in zip(own, read[key], strict=True):
            yield i, _value(readings, k, visits, i, axis)


def _value(readings: Campaign, k: int, visits: VisitedTargets, i: int, axis: str) -> float:
    """The error where the machine stood: the file counts from the target, the row from there."""
    row, c = visits.rows[i], readings.conditions
    kind = Kind[row["kind"].upper()]
    u = np.array([float(row[name]) for name in ("ux", "uy", "uz")])
    if c.u is None or readings.kind[k] != kind or float(np.abs(c.u[k] - u).max()) > _ALONG:
        raise InputError(
            f"the file does not hold what {visits.setup} reads",
            file=readings.name,
            found=f"{Kind(int(readings.kind[k])).name.lower()} along {_vector(c.u, k)}",
            expected=f"{row['kind']} along {_vector(u[None], 0)} (--component)",
        )
    place, target = float(row[axis]), float(c.positions[axis][k])
    own = _own(axis, kind)
    if is_rotary(axis):
        place = float(np.radians(place))
    value = float(readings.value[k]) + (target - place) * float(own @ u)
    return round(value * (1e6 if kind == Kind.ROTATION else 1e3), 4)


def _own(axis: str, kind: Kind) -> NDArray[np.float64]:
    """The direction in which an axis itself moves, as rows of a kind have it; else zeros."""
    if is_rotary(axis):
        turned = np.array([float(axis[0] == name) for name in "ABC"])
        return turned if kind == Kind.ROTATION else np.zeros(3)
    moved = np.asarray(nominal_direction(axis), dtype=np.float64)
    return moved if kind == Kind.DISPLACEMENT else np.zeros(3)


def moving(visits: VisitedTargets) -> str:
    """The only axis that moved in a set-up; raises `InputError` where several did, or none."""
    axes = [c.removesuffix("_dir") for c in visits.columns if c.endswith("_dir")]
    moved = []
    for axis in axes:
        places = [float(row[axis]) for row in visits.rows]
        if places and max(places) - min(places) > _WITHIN:
            moved.append(axis)
    if len(moved) != 1:
        raise InputError(
            "readings are matched along one axis",
            file=visits.path,
            found=", ".join(moved) or "none moved",
            expected=f"a set-up in which one axis moves, not {visits.setup}",
        )
    return moved[0]


def _vector(u: NDArray[np.float64] | None, k: int) -> str:
    return "nothing" if u is None else ", ".join(f"{x:g}" for x in u[k])
