"""Points that a tracker measured in its own frame, beside where the axes stood, to a campaign.

A laser tracker, a total station or a camera on the floor sees a reflector in the spindle or on a
robot's flange: ``C1, B2, …, x, y, z``. How the instrument stands, and where the reflector sits on
the tool where rotary axes move, is found from the points themselves by least squares against the
machine as the model describes it. How it stands stays free in every fit (``frame``); an offset that
is wrong by a little is what `spindle_location` says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.plate import rigid_placing
from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.errors import InputError
from abbe.compcore.files.importers.mistaken_point import mistaken_point
from abbe.compcore.files.importers.placing import ForeignPlacing, Readings, place
from abbe.compcore.files.importers.sheets.logged import (
    LoggedColumn,
    clock_of,
    column_name,
    columns_of,
    is_axis,
    numbers_of,
    signal_of,
    times_of,
)
from abbe.compcore.files.importers.sheets.words import Sheet, as_number, read_sheet, scale_of
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary

F64 = NDArray[np.float64]

COLUMNS = (("x", "y", "z"), ("px", "py", "pz"), ("mx", "my", "mz"))
"""What columns of a tracker's points may be called, where nobody says it."""

_ROUNDS = 50
_STILL = 1e-9
"""mm by which the reflector moves in the last round."""
_FEWEST = 4
FITS = 0.05
"""Part of the points' spread beyond which they are not points of this machine."""


@dataclass(frozen=True, eq=False)
class TrackerPose:
    """How a tracker stands: ``measured = turn · point + shift``; and where the reflector sits.

    Attributes
    ----------
    turn
        Shape (3, 3), from the workpiece's frame to the tracker's.
    shift
        Shape (3,), mm.
    tool
        Shape (3,), mm: the reflector's offset.
    left
        Shape (n, 3), mm: measured − expected, in the workpiece's frame.
    """

    turn: F64
    shift: F64
    tool: F64
    left: F64

    @property
    def rms(self) -> float:
        """What is left, mm."""
        return float(np.sqrt(np.mean(self.left**2)))


def import_points(
    path: str | Path,
    machine: Machine,
    placing: ForeignPlacing | None = None,
    *,
    measured: Sequence[str] | None = None,
    unit: str = "mm",
    tool_known: bool = False,
) -> Campaign:
    """Read a table of axes' positions and a tracker's points.

    Parameters
    ----------
    path
        CSV or a sheet: a column for each axis (mm, rotary degrees), three of the points; a clock
        and signals where there are any.
    machine
        The machine whose axes stood there.
    placing
        Where axes without a column stood, the reflector's offset, its uncertainty.
    measured
        The three columns of the points; None: x y z, px py pz or mx my mz.
    unit
        Of the points.
    tool_known
        Whether the placing's tool offset is known; else, where rotary axes move, it is found.

    Raises
    ------
    InputError
        Naming file, line, column, what was found and what was expected; also when the points are
        none of this machine, or one of them is not.
    """
    source, placing = Path(path), placing or ForeignPlacing()
    sheet = read_sheet(source)
    columns = columns_of(sheet)
    names = _points(columns, measured, sheet)
    lines = np.array([line for line, _ in sheet.rows[1:]])
    if len(lines) < _FEWEST:
        raise InputError(
            "too few points to know how the tracker stands", file=source, found=str(len(lines)),
            expected=f"{_FEWEST} or more",
        )  # fmt: skip
    clock = clock_of(columns)
    rest = [c for c in columns.values() if c not in clock and c.name not in names]
    text = [c.name for c in rest if as_number(sheet.rows[1][1][c.place]) is None]
    axes = [c for c in rest if c.name not in text and is_axis(c.name, machine)]
    signals = {c.name: signal_of(c, sheet) for c in rest if c not in axes and c.name not in text}
    positions = {
        c.name: np.deg2rad(numbers_of(c, sheet)) if is_rotary(c.name) else numbers_of(c, sheet)
        for c in axes
    }
    _check_axes(positions, placing, machine, source)
    time, date = times_of(clock, sheet)
    n = len(lines)
    at = {a: np.full(n, placing.at[a]) for a in placing.at} | positions
    seen = np.stack([numbers_of(columns[c], sheet) for c in names], axis=1)
    seen = seen * scale_of(unit, "mm", sheet.file)
    turning = [a for a in positions if is_rotary(a) and np.ptp(positions[a]) > 0.0]
    free = bool(turning) and not tool_known
    stood = Conditions(at, tool=np.tile(placing.tool, (n, 1)))
    chain = Chain(machine, stood)
    if not float(np.ptp(seen, axis=0).max()) > 0.0:
        raise InputError(
            "the points are all the same", file=source, field=", ".join(names),
            found=f"{n} points at one place", expected="points over the working volume",
        )  # fmt: skip
    spread = float(np.sqrt(np.mean(np.ptp(seen, axis=0) ** 2)))
    pose = _found(chain, seen, placing, FITS * spread, free=free)
    if pose.rms > FITS * spread:

        def rms_of(some: NDArray[np.int64]) -> float:
            part = Chain(machine, stood.rows(some))
            return _found(part, seen[some], placing, FITS * spread, free=free).rms

        if n > _FEWEST and (one := mistaken_point(pose.left, rms_of)) is not None:
            raise InputError(
                "a point does not belong to its axes' positions: is it of another pose, or of a "
                "lost beam? Put it right, or take its line out",
                file=source,
                line=int(lines[one[0]]),
                field=", ".join(names),
                found=f"{pose.rms:.3g} mm rms left of all points",
                expected=f"{one[1]:.3g} mm, as without this one",
            )
        raise InputError(
            "the points are none of this machine, as the model describes it",
            file=source,
            field=", ".join(names),
            found=f"{pose.rms:.3g} mm rms left over {spread:.3g} mm",
            expected="the unit (--unit), each axis's sense and zero, where its line lies (location)"
            + ("" if free else ", the tool's offset (--tool)"),
        )
    error = chain.with_tool(np.tile(pose.tool, (n, 1))).to_machine_axes(pose.left)
    rows = [_readings(k, error[:, k], lines, positions, signals, time) for k in range(3)]
    notes = [
        f"imported from {source.name} (points of a tracker)",
        f"how the instrument stands is found from the points: {pose.rms * 1e3:.4g} µm rms are left",
        "sign: error = measured point − point where the machine as modelled is",
        f"positions: {', '.join(positions)}",
        *([f"signals: {', '.join(signals)}"] if signals else []),
        *([f"left out, since no numbers: {', '.join(text)}"] if text else []),
        *(["no clock: no drift, warm-up or lag can be looked for"] if not clock else []),
    ]
    first, second, third = (round(float(v), 3) for v in pose.tool)
    tool = (first, second, third)
    if free:
        notes.append(
            "the reflector's offset is found too: "
            + ", ".join(f"{v:g}" for v in tool)
            + " mm; what is wrong with it shows as spindle_location. Other files of the same "
            "reflector: --tool " + ",".join(f"{v:g}" for v in tool)
        )
    metadata = {"instrument": "tracker"} | ({} if date is None else {"date": date})
    held = replace(placing, tool=tool)
    return place(source, sheet.data, rows, held, notes, metadata, machine)


def _found(
    chain: Chain, seen: F64, placing: ForeignPlacing, fits: float, *, free: bool
) -> TrackerPose:
    """How the tracker stands; where that leaves more than what fits, mm, looked for otherwise."""
    pose = stand(chain, seen, np.array(placing.tool), free=free)
    if not free or pose.rms <= fits:
        return pose
    # a reflector far from where it was looked for: look on the joints' lines too
    axes = chain.machine.structure.axes
    begun = [chain.machine.axis(a).location for a in axes if is_rotary(a)]
    poses = [stand(chain, seen, np.asarray(p) + placing.tool, free=True) for p in begun]
    return min([pose, *poses], key=lambda found: found.rms)


def stand(chain: Chain, seen: F64, tool: F64, *, free: bool) -> TrackerPose:
    """How a tracker stands, by least squares on its points; with `free` also the tool's offset.

    Gauss–Newton: the best rigid motion (Kabsch), then the offset that what is left asks for.

    Parameters
    ----------
    chain
        The machine at n rows.
    seen
        Shape (n, 3), mm: the points in the tracker's frame.
    tool
        Shape (3,), mm: where to begin.
    free
        Whether the offset is found.
    """
    n = len(seen)
    orientation = np.asarray(chain.orientation)
    for _ in range(_ROUNDS if free else 1):
        point = chain.with_tool(np.tile(tool, (n, 1))).point
        turn, shift = rigid_placing(point, seen)
        left = (seen - shift) @ turn - point
        if not free:
            break
        # the offset's own columns, and those of the rigid motion that goes with it
        about = point - point.mean(axis=0)
        zero = np.zeros(n)
        turned = np.stack(
            [
                np.stack([zero, about[:, 2], -about[:, 1]], axis=1),
                np.stack([-about[:, 2], zero, about[:, 0]], axis=1),
                np.stack([about[:, 1], -about[:, 0], zero], axis=1),
            ],
            axis=1,
        )
        shifted = np.broadcast_to(np.eye(3), (n, 3, 3))
        design = np.concatenate([orientation, turned, shifted], axis=2).reshape(3 * n, 9)
        step = np.linalg.lstsq(design, left.reshape(3 * n), rcond=1e-9)[0][:3]
        tool = tool + step
        if float(np.abs(step).max()) < _STILL:
            break
    point = chain.with_tool(np.tile(tool, (n, 1))).point
    turn, shift = rigid_placing(point, seen)
    return TrackerPose(turn, shift, tool, (seen - shift) @ turn - point)


def _points(
    columns: Mapping[str, LoggedColumn], measured: Sequence[str] | None, sheet: Sheet
) -> tuple[str, str, str]:
    asked = [tuple(map(column_name, measured))] if measured else list(COLUMNS)
    found = next((names for names in asked if set(names) <= set(columns)), None)
    if found is None or len(found) != 3:
        raise InputError(
            "no columns of the points",
            file=sheet.file,
            line=sheet.rows[0][0],
            field=", ".join(measured or ()) or None,
            found=", ".join(columns),
            expected="columns x, y, z in the tracker's frame, or --measured COLUMN=X, =Y and =Z",
        )
    first, second, third = found
    return first, second, third


def _check_axes(
    positions: Mapping[str, F64], placing: ForeignPlacing, machine: Machine, source: Path
) -> None:
    for axis in machine.structure.axes:
        if axis not in positions and axis not in placing.at:
            raise InputError(
                f"where axis {axis} stood is not stated",
                file=source,
                field=axis,
                found=", ".join(positions),
                expected=f"a column '{axis}', or --at {axis}=…",
            )
    for axis in machine.structure.workpiece_side:
        if axis in positions and float(np.ptp(positions[axis])) > 0.0:
            raise InputError(
                "an axis that carries the workpiece moves under a tracker that stands on the floor",
                file=source,
                field=axis,
                expected="points with that axis at rest: one file for each place of it",
            )


def _readings(
    k: int,
    value: F64,
    lines: NDArray[np.int64],
    positions: Mapping[str, F64],
    signals: Mapping[str, F64],
    time: F64,
) -> Readings:
    u = np.zeros((len(value), 3))
    u[:, k] = 1.0
    return Readings(
        positions=positions,
        directions=dict.fromkeys(positions, np.zeros(len(value), dtype=np.int64)),
        kind=Kind.DISPLACEMENT,
        value=value,
        u=u,
        free=("frame",),
        line=lines,
        signals=signals,
        time=time,
    )
