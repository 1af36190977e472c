"""Set-ups along lines: lasers, levels, straightedges, step gauges, diagonals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.machine.machine import nominal_direction, own_component
from abbe.compcore.planning.instruments import PlannedInstrument
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.targets import SurveyTask

F64 = NDArray[np.float64]

PARTS = ((0.5, 0.5), (0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0))
"""Where the other two axes stand, as parts of their travel."""
_AWAY = 150.0
"""mm from the end of a line at which optics stand."""


def line(
    task: SurveyTask,
    instrument: PlannedInstrument,
    ends: Mapping[str, tuple[float, float]],
    count: int,
    u: F64,
    what: str,
    *,
    tool: str = "",
    kind: Kind = Kind.DISPLACEMENT,
    free: tuple[str, ...] = ("zero",),
    runs: int = 1,
) -> PlannedSetup:
    """A straight line on which one or several axes move.

    Parameters
    ----------
    ends
        Axis → where it begins and ends, mm or rad; all axes of the machine.
    u
        What is read, shape (3,) or (c, 3), machine axes.
    """
    way = np.linspace(0.0, 1.0, count)
    targets = {a: np.round(first + way * (last - first), 4) for a, (first, last) in ends.items()}
    named = tool or next(iter(task.tools))
    offset = task.tools[named]
    moving = [a for a, (first, last) in ends.items() if first != last]
    directions = np.broadcast_to(np.atleast_2d(u), (count, np.atleast_2d(u).shape[0], 3)).copy()
    made = PlannedSetup(
        instrument, what, moving[0] if len(moving) == 1 else "", targets, directions, kind, free,
        np.zeros(count), named, offset, runs,
    )  # fmt: skip
    path = made.path()
    lengths = np.linalg.norm(path - path[0], axis=1)
    made.sd[:] = [instrument.uncertainty(float(x)) for x in lengths]
    along = (path[-1] - path[0]) / max(float(lengths[-1]), 1.0)
    stands, moves = path[0] - _AWAY * along, path[-1] + _AWAY * along
    optics = {f"{instrument.title} stands": _place(stands)}
    if instrument.key in ("laser", "angle"):
        optics["the moving optics go as far as"] = _place(path[-1])
    elif instrument.key == "straightness":
        optics["the straightness mirror stands"] = _place(moves)
    elif instrument.key == "level":
        optics = {"one level moves with the axis": _place(path[0])}
    made.optics.update(optics)
    return made


def _place(at: F64) -> tuple[float, float, float]:
    return (float(at[0]), float(at[1]), float(at[2]))


def through(
    task: SurveyTask, axis: str, parts: tuple[float, float], part: tuple[float, float] = (0.0, 1.0)
) -> tuple[dict[str, tuple[float, float]], str]:
    """A line along one axis: ends of all axes, and its place in words."""
    others = [a for a in "XYZ" if a in task.machine.axes and a != axis]
    where = dict(zip(others, parts, strict=False))
    stand = task.standing(where)
    ends = {a: (v, v) for a, v in stand.items()} | {
        axis: (task.at(axis, part[0]), task.at(axis, part[1]))
    }
    return ends, ", ".join(f"{a} {stand[a]:.0f}" for a in where)


def axis_lines(
    task: SurveyTask,
    instrument: PlannedInstrument,
    places: Sequence[tuple[float, float]] = PARTS,
    targets: int = 0,
    free: tuple[float, float] = (0.0, 0.0),
) -> Iterator[PlannedSetup]:
    """All lines along axes that an instrument may measure.

    Parameters
    ----------
    places
        Where the other two axes stand, parts of their travel.
    targets
        How many on each line; 0: by the rule of steps.
    free
        Parts of the line that are left out at its ends.
    """
    for axis in task.machine.structure.linear:
        long = 2.0 * task.machine.axes[axis].half_travel
        share = min(1.0, instrument.reach / long)
        part = (0.5 - share * (0.5 - free[0]), 0.5 + share * (0.5 - free[1]))
        count = targets or max(5, int(np.ceil(share * (task.count(axis) - 1))) + 1)
        seen = set()
        for parts in places:
            ends, place = through(task, axis, parts, part)
            if place in seen:  # without Y a lathe's lines differ by one place, a rail's by none
                continue
            seen.add(place)
            # a machine of one axis has no other that stands anywhere
            where = f" at {place}" if place else ""
            for u, words, kind, unknown in _readings(
                instrument, axis, task.machine.structure.upright
            ):
                tools = task.tools if kind == Kind.DISPLACEMENT else list(task.tools)[:1]
                for tool in tools:
                    beside = f", tool {tool}" if len(task.tools) > 1 else ""
                    yield line(
                        task, instrument, ends, count, u, f"{words}{where}{beside}",
                        tool=tool, kind=kind, free=unknown,
                    )  # fmt: skip


def _readings(
    instrument: PlannedInstrument, axis: str, upright: str
) -> Iterator[tuple[F64, str, Kind, tuple[str, ...]]]:
    own = own_component(axis)
    others = [k for k in "XYZ" if k != own]
    unit = dict(zip("XYZ", np.eye(3), strict=True))
    if instrument.key in ("laser", "step-gauge"):
        yield (
            np.asarray(nominal_direction(axis)),
            f"positioning of {axis}",
            Kind.DISPLACEMENT,
            ("zero",),
        )
    elif instrument.key in ("straightness", "indicator"):
        for k in others:
            yield unit[k], f"straightness of {axis} in {k}", Kind.DISPLACEMENT, ("zero", "slope")
    elif instrument.key == "angle":
        for k in others:
            yield unit[k], f"angle of {axis} about {k}", Kind.ROTATION, ("zero",)
    elif instrument.key == "level":
        # they show tilts about what lies; of a lathe's slant bed nobody knows what does
        for k in "XYZ".replace(upright, "") if upright else "":
            yield unit[k], f"angle of {axis} about {k}", Kind.ROTATION, ("zero",)


def diagonals(
    task: SurveyTask, instrument: PlannedInstrument, *, faces: bool = True, count: int = 0
) -> Iterator[PlannedSetup]:
    """Body diagonals (ISO 230-6) and, where asked for, face diagonals, read by a laser."""
    if any(a not in task.machine.axes for a in "XYZ"):
        return
    for signs in product((1, -1), repeat=2):
        turned = dict(zip("XYZ", (1, *signs), strict=True))
        yield _diagonal(task, instrument, turned, {}, count)
    for pair in ("XY", "YZ", "XZ") if faces else ():
        third = next(k for k in "XYZ" if k not in pair)
        for part, second in product((0.0, 1.0), (1, -1)):
            turned = {pair[0]: 1, pair[1]: second}
            yield _diagonal(task, instrument, turned, {third: part}, count)


def _diagonal(
    task: SurveyTask,
    instrument: PlannedInstrument,
    turned: Mapping[str, int],
    parts: Mapping[str, float],
    count: int,
) -> PlannedSetup:
    count = count or max(task.count(a, moves=a in turned) for a in "XYZ")
    stand = task.standing(parts)
    ends = {a: (v, v) for a, v in stand.items()}
    for a, sign in turned.items():
        low, high = task.ends(a)
        ends[a] = (low, high) if sign > 0 else (high, low)
    u = np.zeros(3)
    for a in turned:
        u += (ends[a][1] - ends[a][0]) * np.asarray(nominal_direction(a))
    name = " ".join(f"{a}{'+' if s > 0 else '−'}" for a, s in turned.items())
    place = "".join(f" at {a} {stand[a]:.0f}" for a in parts)
    kind = "body" if len(turned) == 3 else "face"
    return line(
        task, instrument, ends, count, u / np.linalg.norm(u), f"{kind} diagonal {name}{place}"
    )


def waves(task: SurveyTask, instrument: PlannedInstrument) -> Iterator[PlannedSetup]:
    """Short lines in fine steps, which show the waves that are asked for (rule of steps)."""
    for axis in task.waves:
        fine = task.fine(axis)
        if fine is None or task.machine.axes[axis].rotary:
            continue
        stand = task.standing()
        ends = {a: (v, v) for a, v in stand.items()} | {axis: fine[:2]}
        u = np.asarray(nominal_direction(axis))
        yield line(
            task, instrument, ends, fine[2], u, f"waves of {axis} of {task.waves[axis]:g} mm"
        )
