"""Set-ups that read points in the volume: ball bar, trackers, ball plates, gauge blocks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.machine.machine import nominal_direction
from abbe.compcore.planning.instruments import PlannedInstrument
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups.lines import PARTS, line
from abbe.compcore.planning.targets import SurveyTask

F64 = NDArray[np.float64]

_ANGLES = 72
"""Readings over a turn of the ball bar that are kept."""
_POINTS = 90
_BALLS = 5
"""Balls along each side of a plate."""
_CORNERS = {0.0: "near corner", 1.0: "far corner"}
_BLOCKS = (100.0, 300.0, 500.0)
_BASES: Mapping[str, tuple[float, float]] = {
    "corner 1": (0.02, 0.02), "corner 2": (0.02, 0.98),
    "corner 3": (0.98, 0.02), "corner 4": (0.98, 0.98),
}  # fmt: skip


def _whole(task: SurveyTask) -> bool:
    return all(a in task.machine.axes for a in "XYZ")


def ball_bars(
    task: SurveyTask, instrument: PlannedInstrument, parts: tuple[float, ...] = (0.1, 0.9)
) -> Iterator[PlannedSetup]:
    """Circles in the three planes, at two heights each, as large as travels and bar allow.

    `parts`: the heights, parts of the travel of the axis that stands.
    """
    for pair in ("XY", "YZ", "ZX"):
        if any(a not in task.machine.axes for a in pair):
            continue
        third = next((k for k in "XYZ" if k not in pair and k in task.machine.axes), None)
        half = min(0.5 * (task.ends(a)[1] - task.ends(a)[0]) for a in pair)
        radius = max((r for r in (50.0, 100.0, 150.0, 300.0) if r <= half), default=0.0)
        if not radius or radius > instrument.reach:
            continue
        for part in parts:
            stand = task.standing({} if third is None else {third: part})
            angle = np.linspace(0.0, 2.0 * np.pi, _ANGLES, endpoint=False)
            one, two = (np.asarray(nominal_direction(a)) for a in pair)
            u = np.outer(np.cos(angle), one) + np.outer(np.sin(angle), two)
            targets = {a: np.full(_ANGLES, v) for a, v in stand.items()}
            targets[pair[0]] = stand[pair[0]] + radius * np.cos(angle)
            targets[pair[1]] = stand[pair[1]] + radius * np.sin(angle)
            tool, offset = next(iter(task.tools.items()))
            at = "" if third is None else f" at {third} {stand[third]:.0f}"
            made = PlannedSetup(
                instrument, f"circle in {pair}, radius {radius:.0f} mm{at}", "",
                targets, u[:, None, :], Kind.DISPLACEMENT, ("zero", "frame"),
                np.full(_ANGLES, instrument.uncertainty(radius)), tool, offset,
            )  # fmt: skip
            middle = made.path().mean(axis=0)
            made.optics["the ball stands"] = _place(middle)
            yield made


def distances(
    task: SurveyTask,
    instrument: PlannedInstrument,
    *,
    seed: int = 16907,
    count: int = _POINTS,
    bases: Mapping[str, tuple[float, float]] = _BASES,
) -> Iterator[PlannedSetup]:
    """Distances from base points below the volume to points spread in it.

    Parameters
    ----------
    seed, count
        Of the points.
    bases
        Words for a base point → where it stands, parts of the travels of X and Y.
    """
    if not _whole(task):
        return
    rng = np.random.default_rng(seed)
    for (where, (px, py)), (tool, offset) in product(bases.items(), task.tools.items()):
        spread = _spread(rng, count)
        targets = {a: np.full(count, v) for a, v in task.standing().items()}
        for k, a in enumerate("XYZ"):
            low, high = task.ends(a)
            targets[a] = np.round(low + spread[:, k] * (high - low), 3)
        low_z = task.ends("Z")[0]
        base = np.array([task.at("X", px), task.at("Y", py), low_z - 100.0]) + offset
        beside = f", tool {tool}" if len(task.tools) > 1 else ""
        made = PlannedSetup(
            instrument, f"distances to {count} points from {where}{beside}", "",
            targets, np.zeros((count, 1, 3)), Kind.DISTANCE,
            ("zero",) if instrument.key == "tracker" else (),
            np.zeros(count), tool, offset, both_ways=False, base=_place(base),
        )  # fmt: skip
        reach = np.linalg.norm(made.path() - base, axis=1)
        if reach.max() > instrument.reach:
            continue
        made.sd[:] = [instrument.uncertainty(float(x)) for x in reach]
        made.optics[f"{instrument.title} stands"] = _place(base)
        yield made


def _spread(rng: np.random.Generator, count: int) -> F64:
    """Points spread evenly and at random over the unit cube; the ends included (Latin square)."""
    columns = [rng.permutation(np.linspace(0.0, 1.0, count)) for _ in range(3)]
    return np.stack(columns, axis=1)


def ball_plates(
    task: SurveyTask,
    instrument: PlannedInstrument,
    parts: tuple[float, ...] = (0.05, 0.95),
    corners: tuple[float, ...] = (0.0, 1.0),
) -> Iterator[PlannedSetup]:
    """A plate of 5 × 5 balls in the three planes, at two places each.

    Parameters
    ----------
    parts
        The heights, parts of the travel of the axis that stands.
    corners
        Where it lies in its plane: 0 the near corner, 1 the far one.
    """
    if not _whole(task):
        return
    for pair in ("XY", "YZ", "XZ"):
        third = next(k for k in "XYZ" if k not in pair)
        side = min(instrument.reach, *(task.ends(a)[1] - task.ends(a)[0] for a in pair))
        for part, corner in product(parts, corners):
            stand = task.standing({third: part})
            grid = np.array(list(product(np.linspace(0.0, side, _BALLS), repeat=2)))
            targets = {a: np.full(len(grid), v) for a, v in stand.items()}
            for k, a in enumerate(pair):
                low, high = task.ends(a)
                targets[a] = np.round(low + corner * (high - low - side) + grid[:, k], 3)
            tool, offset = next(iter(task.tools.items()))
            words = f"ball plate of {side:.0f} mm in {pair} at {third} {stand[third]:.0f}"
            made = PlannedSetup(
                instrument, f"{words}, {_CORNERS.get(corner, 'middle')}", "", targets,
                np.broadcast_to(np.eye(3), (len(grid), 3, 3)).copy(), Kind.DISPLACEMENT,
                ("frame",), np.full(len(grid), instrument.uncertainty(side)), tool, offset,
            )  # fmt: skip
            made.optics["the plate lies"] = _place(made.path().mean(axis=0))
            yield made


def gauge_blocks(task: SurveyTask, instrument: PlannedInstrument) -> Iterator[PlannedSetup]:
    """Gauge blocks along the axes and on diagonals of planes, near the middle."""
    for axes in ("X", "Y", "Z", "XY", "YZ", "XZ"):
        if any(a not in task.machine.axes for a in axes):
            continue
        seen = set()
        for length, parts in product(_BLOCKS, PARTS[:3]):
            each = length / np.sqrt(len(axes))
            others = [a for a in "XYZ" if a in task.machine.axes and a not in axes]
            stand = task.standing(dict(zip(others, parts, strict=False)))
            spans = {a: task.ends(a) for a in axes}
            if any(each > high - low for low, high in spans.values()):
                continue
            ends = {a: (v, v) for a, v in stand.items()}
            ends |= {
                a: (0.5 * (low + high - each), 0.5 * (low + high + each))
                for a, (low, high) in spans.items()
            }
            u = np.sum([nominal_direction(a) for a in axes], axis=0) / np.sqrt(len(axes))
            place = ", ".join(f"{a} {stand[a]:.0f}" for a in others)
            if (length, place) in seen:  # a rail has no other place, a lathe one less
                continue
            seen.add((length, place))
            words = f"block of {length:.0f} mm along {axes}{' at ' if place else ''}{place}"
            yield line(
                task, instrument, ends, 2, u, words,
                runs=3,
            )  # fmt: skip


def _place(at: F64) -> tuple[float, float, float]:
    return (float(at[0]), float(at[1]), float(at[2]))
