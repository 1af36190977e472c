"""Commands of machines whose rotary axes have to bring the tool to its point as well as turn it.

An arm of rotary axes, a SCARA robot, a mount, a lathe whose C axis stands in for Y: not all of X, Y
and Z are there. All axes then serve first the place of the functional point, then, with what
freedom is left, the direction of the tool, and last its turn about itself (priorities of tasks:
Siciliano and Slotine 1991, A general framework for managing multiple tasks in highly redundant
robotic systems). Of the moves that do the same the smallest are taken, a rotary axis's as the
longest arc that it draws. Near a singular position (an arm stretched out, a point on the axis that
should move it) the move is damped as near a kinematic pole (`abbe.compcore.model.pose`), and what
is left is reported.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain
from abbe.compcore.model.model import Model
from abbe.compcore.model.wanted_pose import Command, FoundPose, WantedPose, no_command

F64 = NDArray[np.float64]

MOST_TURN_OF_AN_ARM = 0.2
"""rad (11°): farther than this no rotary axis is moved; zeros of arms are off by a degree or so."""
SINGULAR = 0.05
"""Part of the longest arc below which a direction is hard to move in, and is damped."""
_DAMPING = 0.5 * SINGULAR
_ROUNDS = 60
_AT_PLACE = 1e-9
"""mm: a round that moves less than this is the last."""
_LEFT_MM = 1e-6
_LEFT = 1e-9
_RUNAWAY = 1e4


def command_by_all_axes(
    model: Model,
    target: Conditions,
    axis: int,
    held: Sequence[str] = (),
    most: float = MOST_TURN_OF_AN_ARM,
) -> Command:
    """The command at which the real machine takes, as far as it can, the pose of the nominal one.

    Parameters
    ----------
    model
        The model; composed as it says (`Model.composition`).
    target
        Wanted positions of all axes, with tool, temperatures and whatever the effects read.
    axis
        The tool's own direction at zero: 0, 1, 2 for X, Y, Z.
    held
        Rotary axes that are not to be moved.
    most
        rad: farther than this no rotary axis is moved.

    Raises
    ------
    InputError
        When no axis is left that could carry a correction.
    NotContractionError
        When no command can be found: the error changes too fast with position.
    """
    machine = model.machine
    turning = [a for a in machine.structure.rotary if a not in held]
    moving = [*machine.structure.carrying, *turning]
    if not moving:
        raise InputError(
            "the machine has no axis that could carry a correction",
            field="structure",
            found=str(machine.structure),
        )
    wanted = Chain(machine, target)
    pose = WantedPose(model, wanted, axis)
    n = target.n
    arc = _longest_arc(wanted, turning)
    per_unit = np.stack([arc if a in turning else np.ones(n) for a in moving], axis=1)
    least, greatest = _ends(model, target, moving, turning, most)
    now, before, factor = np.zeros((n, len(moving))), np.full(n, np.inf), np.zeros(n)
    at_end = np.zeros(now.shape, dtype=np.bool_)
    for count in range(1, _ROUNDS + 1):
        at = target.moved({a: now[:, k] / per_unit[:, k] for k, a in enumerate(moving)})
        found = pose.at(at)
        free, near = _moves(found, moving, per_unit, arc, now, at_end)
        best = np.clip(free, least * per_unit, greatest * per_unit)
        # an axis that would have to go farther stays at its end, and the others do what they can
        at_end = at_end | (np.abs(best - free) > _LEFT_MM)
        size = np.abs(best - now).max(axis=1)
        now = best
        large = (before > 1e3 * _AT_PLACE) & np.isfinite(before)
        factor[large] = np.maximum(factor[large], size[large] / before[large])
        before = size
        if not np.isfinite(size).all() or size.max(initial=0.0) > _RUNAWAY:
            break
        ended = np.asarray(at_end.any(axis=1))
        settled = size < _AT_PLACE
        # what is out of reach is only approached; how far off it stays is said
        if settled.all() or (count == _ROUNDS and (settled | ended).all()):
            at = target.moved({a: now[:, k] / per_unit[:, k] for k, a in enumerate(moving)})
            found = pose.at(at)
            place = np.linalg.norm(found.place, axis=1)
            direction = np.linalg.norm(found.across, axis=1)
            damped = np.asarray(near & ((place > _LEFT_MM) | (direction > _LEFT)))
            spin = np.abs(found.spin)
            return Command(at, direction, spin, place, damped, ended, count, factor)
    raise no_command(machine, target, before)


def _longest_arc(chain: Chain, turning: Sequence[str]) -> F64:
    """Longest way of the functional point per rad of a rotary axis, (n,), mm; 1 at the least."""
    arcs = [np.linalg.norm(chain.screw(a)[0], axis=1) for a in turning]
    return np.asarray(np.maximum.reduce([np.ones(chain.conditions.n), *arcs]))


def _ends(
    model: Model, target: Conditions, moving: Sequence[str], turning: Sequence[str], most: float
) -> tuple[F64, F64]:
    """How far each axis may move, each (n, axes), mm or rad: a rotary one by `most`, in travel."""
    least = np.full((target.n, len(moving)), -np.inf)
    greatest = -least
    for k, a in enumerate(moving):
        if a in turning:
            low, high = model.machine.axis(a).travel
            here = target.position(a)
            least[:, k] = np.maximum(-most, np.minimum(low - here, 0.0))
            greatest[:, k] = np.minimum(most, np.maximum(high - here, 0.0))
    return least, greatest


def _moves(
    found: FoundPose,
    moving: Sequence[str],
    per_unit: F64,
    arc: F64,
    now: F64,
    at_end: NDArray[np.bool_],
) -> tuple[F64, NDArray[np.bool_]]:
    """All moves from the target, (n, axes), mm, rotary axes' as arcs; and where one was damped.

    Axes `at_end` stay where they are.
    """
    screws = [found.chain.screw(a) for a in moving]
    place = np.stack([s[0] for s in screws], axis=2) / per_unit[:, None, :]
    turn = np.stack([s[1] for s in screws], axis=2) * (arc[:, None] / per_unit)[:, None, :]
    about = np.einsum("nik,ni->nk", turn, found.direction)
    across = turn - found.direction[:, :, None] * about[:, None, :]
    tasks = [
        (place, found.place),
        (across, found.across * arc[:, None]),
        (about[:, None, :], (found.spin * arc)[:, None]),
    ]
    n, count = now.shape
    total = np.where(at_end, now, 0.0)
    freedom = np.eye(count) * ~at_end[:, None, :]
    near: NDArray[np.bool_] = np.zeros(n, dtype=np.bool_)
    for number, (columns, left) in enumerate(tasks):
        need = left + np.einsum("nij,nj->ni", columns, now - total)
        u, s, vt = np.linalg.svd(columns @ freedom, full_matrices=False)
        share = s / (s**2 + _damping(s) ** 2 + 1e-300)
        step = np.einsum("nji,nj->ni", vt, np.einsum("nij,ni->nj", u, need) * share)
        total = total + step
        freedom = freedom - np.einsum("nji,nj,njk->nik", vt, s * share, vt)
        if number == 0:
            asked = np.abs(np.einsum("nij,ni->nj", u, need)) > _LEFT_MM
            near = np.asarray(((s < SINGULAR) & asked).any(axis=1))
    return total, near


def _damping(size: F64) -> F64:
    """Damping of directions that are this hard to move in: none from `SINGULAR` on."""
    return _DAMPING * np.maximum(0.0, 1.0 - (size / SINGULAR) ** 2)
