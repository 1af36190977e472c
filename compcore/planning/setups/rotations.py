"""Set-ups of rotary axes: a sphere is followed (ISO 10791-6, R-test), an angle is read (230-2)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.iso10791.poses import following
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.planning.instruments import PlannedInstrument
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.probing.room import room_about
from abbe.compcore.planning.targets import SurveyTask

F64 = NDArray[np.float64]

_OUT = (80.0, 160.0)
"""How far from the axis's line a sphere stands, mm."""
_UP = (60.0, 200.0)
"""How high above the table, mm."""
_FEWEST = 5
"""Angles below which a sphere says too little of an axis."""
_PARTS = 16
"""Steps from one angle to the next at which a sphere's arc is looked at."""
_OTHERS = (None, 0.25, 0.6)
"""Where other rotary axes stand: at 0, or at a part of their travel."""


def spheres(
    task: SurveyTask,
    instrument: PlannedInstrument,
    outs: Sequence[float] = _OUT,
    ups: Sequence[float] = _UP,
    parts: Sequence[float | None] = _OTHERS,
    more: int = 0,
) -> Iterator[PlannedSetup]:
    """A sphere on the table is followed while one rotary axis turns, others at two angles.

    Parameters
    ----------
    outs, ups
        How far from the axis's line, and how high above the table it stands, mm.
    parts
        Where other rotary axes stand: None at 0, or at a part of their travel.
    more
        Angles besides those of a usual plan, so that they are others.
    """
    machine = task.machine
    rotary = machine.structure.rotary
    if any(a not in machine.axes for a in "XYZ"):
        return
    for axis in rotary:
        angles = _angles(task, axis, more)
        others = [a for a in rotary if a != axis]
        for out, up, (tool, offset) in product(outs, ups, task.tools.items()):
            for part in parts if others else parts[:1]:
                stand = task.standing()
                if part is not None:
                    turned = {a: round(np.degrees(task.at(a, part)), 1) for a in others}
                    stand |= {a: float(np.radians(v)) for a, v in turned.items()}
                sphere = _sphere(task, out, up)
                turning = {a: np.full(len(angles), stand[a]) for a in others}
                tools = np.tile(np.asarray(offset), (len(angles), 1))
                point = np.tile(sphere, (len(angles), 1))
                targets = following(machine, turning | {axis: angles}, point, tools)
                kept, fewest = _reached(task, targets), max(_FEWEST, len(angles) // 2)
                if instrument.held:
                    fine = _between(angles)
                    on_the_way = following(
                        machine,
                        {a: np.full(len(fine), stand[a]) for a in others} | {axis: fine},
                        np.tile(sphere, (len(fine), 1)),
                        np.tile(np.asarray(offset), (len(fine), 1)),
                    )
                    kept = _longest_way(kept, _inside(task, on_the_way))
                if instrument.key == "sphere":
                    fewest = _FEWEST
                    kept &= room_about(machine, targets, offset)
                    kept &= ~task.space.cannot_touch(machine, targets, offset)[0]
                if kept.sum() < fewest:
                    continue
                targets = {
                    a: q[kept] if a in rotary else np.round(q[kept], 4) for a, q in targets.items()
                }
                place = "".join(f", {a} {np.degrees(stand[a]):.0f}°" for a in others)
                beside = f", tool {tool}" if len(task.tools) > 1 else ""
                count = int(kept.sum())
                yield PlannedSetup(
                    instrument,
                    f"{axis} turns, sphere {out:.0f} mm out, {up:.0f} mm up{place}{beside}", axis,
                    targets, np.broadcast_to(np.eye(3), (count, 3, 3)).copy(), Kind.DISPLACEMENT,
                    ("frame",), np.full(count, instrument.uncertainty(0.0)), tool, offset,
                    optics={"the sphere stands": (sphere[0], sphere[1], sphere[2])},
                )  # fmt: skip


def turns(task: SurveyTask, instrument: PlannedInstrument, more: int = 0) -> Iterator[PlannedSetup]:
    """Each rotary axis turns alone, and how far it has turned is read (ISO 230-2).

    Parameters
    ----------
    more
        Targets besides those of a usual plan, so that they are others.
    """
    machine = task.machine
    stand = task.standing()
    for axis in machine.structure.rotary:
        angles = _angles(task, axis, more)
        targets = {a: np.full(len(angles), q) for a, q in stand.items()} | {axis: angles}
        along = np.asarray(machine.axes[axis].direction, dtype=np.float64)
        tool, offset = next(iter(task.tools.items()))
        yield PlannedSetup(
            instrument, f"angle of {axis}, {len(angles)} of them", axis, targets,
            np.tile(along, (len(angles), 1, 1)), Kind.ROTATION, ("zero",),
            np.full(len(angles), instrument.uncertainty(0.0)), tool, offset,
        )  # fmt: skip


def _angles(task: SurveyTask, axis: str, more: int = 0) -> F64:
    low, high = task.ends(axis)
    count = task.count(axis) + more
    turn = 2.0 * np.pi
    if 2.0 * task.machine.axes[axis].half_travel >= turn * (1.0 - 1e-9):
        angles = np.linspace(low, low + turn, count, endpoint=False)
    else:
        angles = np.linspace(low, high, count)
    return np.asarray(np.radians(np.round(np.degrees(angles), 2)))


def _sphere(task: SurveyTask, out: float, up: float) -> F64:
    """A place on the table: beside the line of its axis, or in the middle of the travels."""
    machine = task.machine
    table = [a for a in machine.structure.rotary if a in machine.structure.workpiece_side]
    if table:
        own = machine.axes[table[0]]
        along = np.asarray(own.direction)
        across = np.eye(3)[int(np.argmin(np.abs(along)))]
        return np.asarray(np.asarray(own.location) + out * across + up * along)
    stand = task.standing()
    middle = np.array([stand[a] for a in "XYZ"]) + next(iter(task.tools.values()))
    return np.asarray(middle + np.array([out, 0.0, up - _UP[0]]))


def _reached(task: SurveyTask, targets: dict[str, F64]) -> NDArray[np.bool_]:
    """Which poses lie inside the travels; of axes that move with room to come from both sides."""
    kept = np.ones(len(next(iter(targets.values()))), dtype=np.bool_)
    for a in task.machine.structure.linear:
        # a quill that stands drawn back stands at the end of its travel
        moves = float(np.ptp(targets[a])) > 0.0
        low, high = task.ends(a) if moves else task.machine.axes[a].travel
        kept &= (targets[a] >= low) & (targets[a] <= high)
    return kept


def _between(angles: F64) -> F64:
    """Angles with `_PARTS` steps from each to the next."""
    steps = np.arange(_PARTS * (len(angles) - 1) + 1) / _PARTS
    return np.asarray(np.interp(steps, np.arange(len(angles)), angles))


def _inside(task: SurveyTask, targets: dict[str, F64]) -> NDArray[np.bool_]:
    """Which poses lie inside the travels of the linear axes."""
    inside = np.ones(len(next(iter(targets.values()))), dtype=np.bool_)
    for a in task.machine.structure.linear:
        low, high = task.machine.axes[a].travel
        inside &= (targets[a] >= low) & (targets[a] <= high)
    return inside


def _longest_way(kept: NDArray[np.bool_], inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The most targets one after another between which the sphere can be followed, (k,).

    What the tool holds stays at the sphere from the first target to the last: where its arc leaves
    the travels there is no way to the next one.

    Parameters
    ----------
    kept
        Targets that can be reached, (k,).
    inside
        Whether the arc is inside the travels, at `_between` them.
    """
    best, start = (0, 0), 0
    for k in range(len(kept) + 1):
        ends = k == len(kept) or not kept[k]
        if not ends and k > start and not inside[_PARTS * (k - 1) : _PARTS * k + 1].all():
            best, start = max(best, (k - start, -start)), k
        if ends:
            best, start = max(best, (k - start, -start)), k + 1
    count, first = best[0], -best[1]
    return (np.arange(len(kept)) >= first) & (np.arange(len(kept)) < first + count)


def functional_points(task: SurveyTask, setup: PlannedSetup) -> F64:
    """The functional point at each target, (k, 3), mm, in the workpiece's frame."""
    tools = np.tile(np.asarray(setup.offset), (setup.count, 1))
    return Chain(task.machine, Conditions(dict(setup.targets), tool=tools)).point
