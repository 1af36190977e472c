"""A test of rotary axes as a file describes it: what its columns are, and how they are meant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.placing import ForeignPlacing, Readings
from abbe.compcore.files.importers.sheets.roles import RoleColumns, Words
from abbe.compcore.files.importers.sheets.words import as_number, direction, scale_of, unit_of
from abbe.compcore.iso10791.poses import around, following, nest_directions
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.plausible import POINT, Range, position_range

F64 = NDArray[np.float64]

NESTS = ("spindle", "table")
DIRECTIONS = ("nest", "machine")
_SENSORS = ("dX", "dY", "dZ")
_AROUND = ("radial", "tangential", "axial")
_ERROR = Range(-100.0, 100.0, "mm")

Rows = list[tuple[int, list[str]]]
"""Lines of a file: number and cells."""


@dataclass(frozen=True)
class RotaryTestOptions:
    """What an R-test's file may not say itself.

    Attributes
    ----------
    nest
        What carries the sensors: ``spindle`` (the sphere is on the table) or ``table``.
    directions
        Whether dX, dY, dZ are the nest's own directions, which turn with what carries it, or those
        of the machine.
    axis
        The rotary axis about which radial and tangential are meant, where several turn.
    unit
        Of the readings.
    placed
        Whether each sphere is where it is stated and the nest's zero is its middle; else every
        sphere stands anyhow near its place.
    """

    nest: str | None = None
    directions: str | None = None
    axis: str | None = None
    unit: str | None = None
    placed: bool = False


@dataclass(frozen=True)
class RotaryTest:
    """A file of a test of rotary axes: what its columns are, and how they are meant.

    Attributes
    ----------
    rotary
        The rotary axes that have a column.
    names
        The columns with readings.
    nest, frame, axis
        As in `RotaryTestOptions`; `frame` are the directions.
    unit, per_unit
        Of the readings, and mm in one.
    """

    columns: RoleColumns
    machine: Machine
    placing: ForeignPlacing
    options: RotaryTestOptions
    rotary: list[str]
    names: list[str]
    nest: str | None
    frame: str
    axis: str | None
    unit: str
    per_unit: float

    @classmethod
    def of(
        cls,
        columns: RoleColumns,
        machine: Machine,
        placing: ForeignPlacing,
        options: RotaryTestOptions,
    ) -> RotaryTest:
        """The test that the columns, the comments above them and the options describe.

        Raises
        ------
        InputError
            Naming file, line, column, what was found and what was expected.
        """
        sheet, where = columns.sheet, columns.where
        rotary = [a for a in machine.structure.rotary if a in where]
        names = [k for k in (*_SENSORS, *_AROUND) if k in where]
        if not rotary or not names:
            raise InputError(
                "not a test of rotary axes",
                file=sheet.file,
                line=sheet.rows[0][0],
                found=", ".join(sheet.rows[0][1]),
                expected=f"columns {' or '.join(machine.structure.rotary) or 'of rotary axes'} "
                "(degrees) and dX,dY,dZ, or radial,tangential,axial",
            )
        sensors, about = set(names) & set(_SENSORS), set(names) & set(_AROUND)
        nest = _word(columns, "nest", options.nest, NESTS, needed=bool(sensors))
        frame = _word(columns, "directions", options.directions, DIRECTIONS) or "nest"
        unit, per_unit = _unit(columns, names, options.unit)
        axis = _axis(columns, options.axis, rotary, machine) if about else None
        return cls(
            columns, machine, placing, options, rotary, names, nest, frame, axis, unit, per_unit
        )

    def read(self, sphere: str, rows: Rows) -> Iterator[Readings]:
        """The readings at one sphere, one for each column.

        Raises
        ------
        InputError
            Naming file, line, column, what was found and what was expected.
        """
        columns = self.columns
        positions, tool = _positions(columns, rows, self.machine, self.placing, self.rotary, sphere)
        along = self._directions(Chain(self.machine, Conditions(positions, tool=tool)))
        lines = np.array([line for line, _ in rows])
        senses = _senses(columns, rows, self.rotary)
        still = np.zeros(len(rows), dtype=np.int64)
        recorded = [columns.signals(line, cells) for line, cells in rows]
        for name in self.names:
            at, u = columns.where[name], along[name]
            value = np.array([columns.cell(n, c, at, name, _ERROR, self.per_unit) for n, c in rows])
            # a nest in the spindle sees the sphere, and so the workpiece, relative to the tool
            turned = -1.0 if name in _SENSORS and self.nest == "spindle" else 1.0
            seen = np.linalg.norm(u, axis=1) > 0.5
            if not seen.all():
                raise InputError(
                    f"nothing is {name} on the axis's own line",
                    file=columns.sheet.file,
                    line=int(lines[~seen][0]),
                    field="sphere",
                    expected="a sphere beside the line",
                )
            yield Readings(
                positions,
                {a: senses.get(a, still) for a in positions},
                Kind.DISPLACEMENT,
                turned * value,
                u,
                () if self.options.placed else ("frame",),
                lines,
                f" {sphere}" if sphere else "",
                signals={k: np.array([r[k] for r in recorded]) for k in columns.others},
                tool=tool,
            )

    def _directions(self, chain: Chain) -> dict[str, F64]:
        """Column → the direction in which it was measured at each pose, (n, 3)."""
        along = dict(zip(_SENSORS, _sensors(chain, self.nest, self.frame), strict=True))
        if self.axis is not None:
            along |= dict(zip(_AROUND, around(chain, self.axis), strict=True))
        return along

    def notes(self) -> Iterator[str]:
        """What the readings were taken for, in words."""
        if set(self.names) & set(_SENSORS):
            sees = "sphere relative to nest"
            sees = f"−({sees})" if self.nest == "spindle" else sees
            yield (
                f"the nest is on the {self.nest}: error of the tool = {sees}, {self.frame} "
                "directions"
            )
        if self.axis is not None:
            yield (
                f"radial outward from {self.axis}, tangential the way {self.axis} counts, "
                "tool − table"
            )


def words(machine: Machine) -> Words:
    """What the columns of such a file may be called."""
    axes = {a: (a.lower(),) for a in machine.structure.axes}
    senses = {f"{a}_dir": (f"{a.lower()}_dir",) for a in machine.structure.rotary}
    named = {k: (k.lower(),) for k in (*_SENSORS, *_AROUND)}
    return {**axes, **senses, **named, "sphere": ("sphere", "ball"), "run": ("run", "no")}


def _word(
    columns: RoleColumns,
    key: str,
    given: str | None,
    known: tuple[str, ...],
    *,
    needed: bool = False,
) -> str | None:
    word = given or columns.sheet.comments.get(key)
    if (word is None and needed) or (word is not None and word.lower() not in known):
        raise InputError(
            f"the {key} is not stated" if word is None else f"no such {key}",
            file=columns.sheet.file,
            field=key,
            found=word,
            expected=f"{' or '.join(known)} (--{key}, or a line # {key} = {known[0]})",
        )
    return None if word is None else word.lower()


def _unit(columns: RoleColumns, names: list[str], given: str | None) -> tuple[str, float]:
    values = [
        v
        for _, cells in columns.sheet.rows[1:]
        for name in names
        if (v := as_number(cells[columns.where[name]])) is not None
    ]
    stated = next((columns.units[n] for n in names if n in columns.units), None)
    unit = unit_of(given, stated, values, columns.sheet.file, rotation=False)
    return unit, scale_of(unit, "mm", columns.sheet.file, columns.sheet.rows[0][0])


def spheres(columns: RoleColumns) -> dict[str, Rows]:
    """The lines of each sphere, by its name."""
    found: dict[str, Rows] = {}
    for line, cells in columns.sheet.rows[1:]:
        name = cells[columns.where["sphere"]] if "sphere" in columns.where else ""
        found.setdefault(name, []).append((line, cells))
    return found


def _positions(
    columns: RoleColumns,
    rows: Rows,
    machine: Machine,
    placing: ForeignPlacing,
    rotary: list[str],
    sphere: str,
) -> tuple[dict[str, F64], F64]:
    """Where all axes stood, and the tool, (n, 3) mm."""
    n = len(rows)
    tool = np.array([columns.tool(line, cells, placing.tool) for line, cells in rows])
    moved: dict[str, F64] = {a: np.full(n, v) for a, v in placing.at.items() if a in machine.axes}
    for axis in machine.structure.axes:
        if axis in columns.where:
            allowed = position_range(machine.axes[axis])
            read = np.array([columns.number(line, cells, axis, allowed) for line, cells in rows])
            moved[axis] = np.deg2rad(read) if axis in rotary else read
    if all(a in moved for a in "XYZ"):
        return {a: moved.get(a, np.zeros(n)) for a in machine.structure.axes}, tool
    place_of = _sphere(columns, sphere)
    return following(machine, moved, np.tile(place_of, (n, 1)), tool), tool


def _sphere(columns: RoleColumns, name: str) -> tuple[float, float, float]:
    comments: Mapping[str, str] = columns.sheet.comments
    key = f"sphere {name}".strip().lower()
    text = comments.get(key, comments.get("sphere", ""))
    parts = [as_number(p) for p in text.strip("[]()").split(",")]
    found = [p for p in parts if p is not None and POINT.holds(p)]
    if len(parts) != 3 or len(found) != 3:
        raise InputError(
            "where the sphere is, is not stated" if not text else "not a place",
            file=columns.sheet.file,
            field=key,
            found=text or None,
            expected=f"a line # {key} = x, y, z: X, Y, Z + tool when the tool is at the sphere and "
            "the rotary axes at 0, mm; or columns X, Y, Z",
        )
    return found[0], found[1], found[2]


def _sensors(chain: Chain, nest: str | None, frame: str) -> list[F64]:
    if frame == "machine":
        return [np.tile(e, (chain.conditions.n, 1)) for e in np.eye(3)]
    turned = nest_directions(chain, on_table=nest == "table")
    return [turned[:, k] for k in range(3)]


def _axis(columns: RoleColumns, given: str | None, rotary: list[str], machine: Machine) -> str:
    name = given or columns.sheet.comments.get("axis")
    if name is None and len(rotary) == 1:
        name = rotary[0]
    if name is None or name not in machine.structure.rotary:
        raise InputError(
            "which axis radial and tangential are about is not stated" if name is None
            else "not a rotary axis of the machine",
            file=columns.sheet.file,
            field="axis",
            found=name,
            expected=f"one of {', '.join(machine.structure.rotary)} (--axis, or # axis = "
            f"{rotary[0]})",
        )  # fmt: skip
    return name


def _senses(columns: RoleColumns, rows: Rows, rotary: list[str]) -> dict[str, NDArray[np.int64]]:
    found = {}
    for axis in rotary:
        if (role := f"{axis}_dir") in columns.where:
            at = columns.where[role]
            found[axis] = np.array([direction(c[at], columns.sheet, n, role) for n, c in rows])
    return found
