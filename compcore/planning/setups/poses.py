"""Points in space of machines that reach them by joints: poses that a tracker beside looks at.

An arm, a SCARA robot, a column with an arm on it: poses spread over the travels of all axes that
carry the tool, and of some of them while the others stand. A laser tracker reads X, Y and Z in a
frame of its own, a tracking interferometer its distance to the reflector.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.instruments import PlannedInstrument
from abbe.compcore.planning.planned_setup import FEED, TURN_RATE, PlannedSetup, tip_at
from abbe.compcore.planning.setups.seen import Links
from abbe.compcore.planning.targets import SurveyTask

F64 = NDArray[np.float64]
Index = NDArray[np.int64]

STANDS: Mapping[str, float] = {"in front": 0.0, "its left": 90.0, "its right": -90.0}
"""Words for where a tracker stands → degrees from where the tip usually is, seen from above."""
_POINTS = 100
"""Poses over all axes, or twice as many; half as many over some of them."""
_FEWEST = 20
"""Poses below which a set-up is not worth a stand."""
_SAMPLES = 400
_BEYOND = 500.0
"""mm from all that the tip reaches at which a tracker stands at least."""
_FLAT = 0.05
"""Part of their longest extent that points in space have across."""
_TRIED = 14
"""Poses among which the first is chosen, beside keep-out boxes."""
_ROUNDS = 8
"""How many times as many poses are looked at as are wanted."""
_STAND = (0.5, 0.25)
"""Where axes stand that rest, parts of their travel."""
_FEW = 3
"""Joints up to which all of them move always."""


@dataclass(frozen=True, slots=True)
class _Some:
    """Some axes that move while the others stand."""

    words: str
    axes: tuple[str, ...]
    stand: Mapping[str, float]
    count: int


def planned_by_joints(task: SurveyTask) -> bool:
    """Whether poses are planned in place of X, Y, Z: joints, and not all of these."""
    structure = task.machine.structure
    return bool(structure.rotary) and len(structure.carrying) < len("XYZ")


def poses(
    task: SurveyTask,
    instrument: PlannedInstrument,
    stands: Mapping[str, float] = STANDS,
    count: int = _POINTS,
    seed: int = 16907,
    *,
    some: bool = True,
) -> Iterator[PlannedSetup]:
    """Poses from every stand, with every tool.

    Parameters
    ----------
    stands
        Where the tracker stands, as `STANDS`.
    count, seed
        Of the poses over all axes.
    some
        Whether sets in which only some of the axes move are among them.
    """
    moving = task.machine.structure.tool_side
    if not planned_by_joints(task) or not moving:
        return
    number = 0
    for tool, offset in task.tools.items():
        room = _Room.of(task, moving, offset)
        for (where, angle), part in product(stands.items(), _sets(task, moving, count, some=some)):
            number += 1
            place = room.beside(angle, instrument)
            rng = np.random.default_rng([seed, number])
            targets = _targets(task, part, offset, place, room.reach, rng)
            if targets is None:
                continue
            found = len(next(iter(targets.values())))
            beside = f", tool {tool}" if len(task.tools) > 1 else ""
            what = f"{found} poses, {part.words}, from {where}{beside}"
            made = _set_up(instrument, what, targets, (tool, offset), place, found)
            tips = made.stood(task.machine)
            far = np.linalg.norm(tips - place, axis=1)
            if far.max() > instrument.reach or (made.base is not None and not _in_space(tips)):
                continue
            made.sd[:] = [instrument.uncertainty(float(x)) for x in far]
            made.optics[f"{instrument.title} stands"] = _place(place)
            yield made


def _in_space(tips: F64) -> bool:
    """Whether points lie in no plane: distances to such say where their base is."""
    size = np.linalg.svd(tips - tips.mean(axis=0), compute_uv=False)
    return bool(size[2] > _FLAT * size[0])


def _set_up(
    instrument: PlannedInstrument,
    what: str,
    targets: Mapping[str, F64],
    tool: tuple[str, tuple[float, float, float]],
    place: F64,
    count: int,
) -> PlannedSetup:
    if instrument.key == "tracker":
        return PlannedSetup(
            instrument, what, "", targets, np.zeros((count, 1, 3)), Kind.DISTANCE, ("zero",),
            np.zeros(count), *tool, both_ways=False, base=_place(place),
        )  # fmt: skip
    return PlannedSetup(
        instrument, what, "", targets, np.tile(np.eye(3), (count, 1, 1)), Kind.DISPLACEMENT,
        ("frame",), np.zeros(count), *tool, both_ways=False,
    )  # fmt: skip


def _sets(task: SurveyTask, moving: Sequence[str], count: int, *, some: bool) -> Iterator[_Some]:
    """All axes, the first and the last of them, each of them alone."""
    every = f"all of {', '.join(moving)}"
    yield _Some(every, tuple(moving), task.standing(), count)
    if not some:
        return
    yield _Some(every, tuple(moving), task.standing(), 2 * count)
    half = (len(moving) + 1) // 2
    for part in _STAND:
        stand = task.standing() | {a: task.at(a, part) for a in moving if is_rotary(a)}
        if len(moving) > _FEW:
            first, last = tuple(moving[:half]), tuple(moving[half:])
            fewer = max(count // 2, _FEWEST)
            yield _Some(_words(first, moving, stand), first, stand, fewer)
            yield _Some(_words(last, moving, stand), last, stand, fewer)
        for axis in moving:
            yield _Some(_words((axis,), moving, stand), (axis,), stand, _FEWEST)


def _words(axes: Sequence[str], moving: Sequence[str], stand: Mapping[str, float]) -> str:
    still = [
        f"{a} {np.degrees(stand[a]):.0f}°" if is_rotary(a) else f"{a} {stand[a]:.0f}"
        for a in moving
        if a not in axes
    ]
    return f"{', '.join(axes)} with {', '.join(still)}" if still else ", ".join(axes)


@dataclass(frozen=True, eq=False)
class _Room:
    """Where the tip goes: the middle of it, how far, and in front; mm."""

    middle: F64
    reach: float
    front: F64
    up: F64

    @classmethod
    def of(cls, task: SurveyTask, moving: Sequence[str], offset: Sequence[float]) -> _Room:
        rng = np.random.default_rng(_SAMPLES)
        some = _Some("", tuple(moving), task.standing(), _SAMPLES)
        tips = tip_at(task.machine, _spread(task, some, rng, _SAMPLES), offset)
        up = np.eye(3)["XYZ".index(task.machine.structure.upright or "Z")]
        middle = 0.5 * (tips.min(axis=0) + tips.max(axis=0))
        level = np.eye(3) - np.outer(up, up)
        reach = float(np.linalg.norm((tips - middle) @ level, axis=1).max())
        foot = next((a for a in moving if is_rotary(a)), None)
        line = middle if foot is None else np.asarray(task.machine.axis(foot).location)
        front = level @ (tips.mean(axis=0) - line)
        if float(np.linalg.norm(front)) < 0.1 * reach:
            front = level @ np.array([1.0, 0.0, 0.0] if up[0] < 1.0 else [0.0, 1.0, 0.0])
        return cls(middle, reach, front / np.linalg.norm(front), up)

    def beside(self, angle: float, instrument: PlannedInstrument) -> F64:
        """A place outside of what the tip reaches, at the height of its middle, mm."""
        turn = np.radians(angle)
        way = np.cos(turn) * self.front + np.sin(turn) * np.cross(self.up, self.front)
        out = self.reach + max(_BEYOND, instrument.nearest)
        return np.asarray(np.round(self.middle + out * way))


def _spread(task: SurveyTask, some: _Some, rng: np.random.Generator, count: int) -> dict[str, F64]:
    """Poses spread evenly and at random over travels, the ends included (Latin square)."""
    targets = {a: np.full(count, v) for a, v in some.stand.items()}
    for axis in some.axes:
        low, high = task.ends(axis)
        at = low + rng.permutation(np.linspace(0.0, 1.0, count)) * (high - low)
        rotary = is_rotary(axis)
        targets[axis] = np.radians(np.round(np.degrees(at), 3)) if rotary else np.round(at, 3)
    return targets


def _targets(
    task: SurveyTask,
    some: _Some,
    offset: Sequence[float],
    place: F64,
    reach: float,
    rng: np.random.Generator,
) -> dict[str, F64] | None:
    """Poses that are seen from a place and free of boxes, in a short order; None: too few."""
    kept: list[dict[str, float]] = []
    for _ in range(_ROUNDS):
        drawn = _spread(task, some, rng, some.count)
        links = Links(task.machine, drawn, offset, reach)
        free = np.flatnonzero(links.seen_from(place) & links.apart())
        found = [{a: float(q[i]) for a, q in drawn.items()} for i in free.tolist()]
        if not kept and found:
            kept.append(_first(task, offset, found))
        # from the first one, to which an instrument's drift is checked, to each of them
        more = [p for p in found if p is not kept[0] and _free(task, offset, kept[0], p)]
        kept += more[: some.count - len(kept)]
        if len(kept) == some.count:
            break
    if len(kept) < _FEWEST:
        return None
    order = _in_order(task, offset, kept)
    if len(order) < _FEWEST:
        return None
    return {a: np.array([kept[i][a] for i in order]) for a in task.machine.axes}


def _first(
    task: SurveyTask, offset: Sequence[float], found: Sequence[dict[str, float]]
) -> dict[str, float]:
    """The pose, of some, from which most of the others are reached over a free way."""
    tried = found[:_TRIED] if task.space.keep_out else found[:1]
    if len(tried) < 2:
        return tried[0]
    return max(tried, key=lambda p: sum(_free(task, offset, p, q) for q in tried))


def _free(
    task: SurveyTask, offset: Sequence[float], one: Mapping[str, float], two: Mapping[str, float]
) -> bool:
    way = {a: np.array([q, two[a]]) for a, q in one.items()}
    return task.space.entered(task.machine, way, offset, turns=True) is None


def _in_order(
    task: SurveyTask, offset: Sequence[float], kept: Sequence[Mapping[str, float]]
) -> list[int]:
    """From the first always to the one that is reached soonest over a free way."""
    axes = list(kept[0])
    pace = np.array([TURN_RATE if is_rotary(a) else FEED for a in axes])
    at = np.array([[pose[a] for a in axes] for pose in kept]) / pace
    order, left = [0], list(range(1, len(kept)))
    while left:
        here = order[-1]
        times = np.abs(at[left] - at[here]).max(axis=1)
        soonest = [left[k] for k in np.argsort(times).tolist()]
        then = next((i for i in soonest if _free(task, offset, kept[here], kept[i])), None)
        if then is None:
            # a pose that leads nowhere is left out; from the first one all others are free
            order.pop()
            continue
        order.append(then)
        left.remove(then)
    return order


def _place(at: F64) -> tuple[float, float, float]:
    return (float(at[0]), float(at[1]), float(at[2]))
