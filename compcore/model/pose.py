"""Commands that bring the tool to a point and to its orientation (ISO/TR 16907, 8.2: FOR).

Errors turn the tool as well as move it. Where the structure has rotary axes they can turn it back
(ISO/TR 16907, 8.2: FOR, R-POS … L-VOL+), and the linear axes then bring its tip to where it
belongs. What counts is the direction of the tool; its turn about itself counts only where an axis
of the machine can do nothing else (a rotary table whose axis stands along the tool).

Near a *kinematic pole* the direction of an axis falls in with that of the tool: it would have to
turn ever farther for ever less (1/sin B on a head). Below `POLE` its part is damped, and the
solution is the best compromise between what is left and how far axes have to turn; what is left is
reported: an axis turns by at most 26 times the lean that it corrects.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.conditions import Conditions
from abbe.compcore.machine.kinematics import Chain, crossed
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Model
from abbe.compcore.model.pose_by_all_axes import command_by_all_axes
from abbe.compcore.model.wanted_pose import Command, FoundPose, WantedPose, no_command

F64 = NDArray[np.float64]

POLE = 0.05
"""Sine of the angle between axis and tool (2.9°) below which a rotary axis is damped."""
DAMPING = 0.5 * POLE
"""Damping of an axis that stands along the tool; none from `POLE` on."""
MOST_TURN = 5e-3
"""rad: farther than this (0.29°) no rotary axis is moved for the sake of orientation."""
_SPINS = 1e-9
"""Sine below which an axis, everywhere, only turns the tool about itself."""
_ROUNDS = 60
_AT_PLACE = 1e-10
"""mm: farther than this the found command is not from its solution."""
_AT_ANGLE = 1e-12
_RUNAWAY = 1e4
_LEFT = 1e-9
"""rad: less than this counts as nothing left."""
_SPINDLE_AXIS = {"A": 0, "B": 1, "C": 2}


def tool_letter(machine: Machine) -> str:
    """The tool's own direction at zero: that of the spindle in brackets, else Z.

    >>> from abbe.compcore.machine.structure import Structure
    >>> from abbe.compcore.machine.machine import Axis
    >>> tool_letter(Machine("", Structure.parse("w b X (B) t"), {"X": Axis("X", (0.0, 1.0))}))
    'Y'
    """
    spindle = machine.structure.spindle
    return "XYZ"[_SPINDLE_AXIS[spindle[0]]] if spindle else "Z"


def command_of(
    model: Model,
    target: Conditions,
    *,
    held: Collection[str] = (),
    most: float = MOST_TURN,
) -> Command:
    """The command at which the real machine takes the pose that the nominal one has at a target.

    Where one of X, Y, Z is missing, rotary axes bring the tool to its point too
    (`abbe.compcore.model.pose_by_all_axes`).

    Parameters
    ----------
    model
        The model; composed as it says (`Model.composition`).
    target
        Wanted positions of all axes, with tool, temperatures and whatever the effects read.
    held
        Rotary axes that are not to be moved.
    most
        rad: farther than this no rotary axis is moved for the sake of orientation.

    Raises
    ------
    InputError
        When no axis is left that could carry a correction.
    NotContractionError
        When no command can be found: the error changes too fast with position.
    """
    machine = model.machine
    axis = "XYZ".index(tool_letter(machine))
    if len(machine.structure.carrying) < len("XYZ"):
        return command_by_all_axes(model, target, axis, tuple(held))
    wanted = Chain(machine, target)
    spinning = spinning_axes(machine, axis)
    turning = [a for a in machine.structure.rotary if a not in held]
    linear = [*"XYZ"]
    pose = WantedPose(model, wanted, axis)
    n = target.n
    moved = {a: np.zeros(n) for a in [*linear, *turning]}
    before, factor = np.full(n, np.inf), np.zeros(n)
    limited = np.zeros(n, dtype=np.bool_)
    for count in range(1, _ROUNDS + 1):
        at = target.moved(moved)
        found = pose.at(at)
        turned, limited = _turns(found, target, moved, turning, spinning, machine, most)
        shift = found.place
        for a in turning:
            shift = shift - found.chain.screw(a)[0] * (turned[a] - moved[a])[:, None]
        axes = np.stack([found.chain.screw(a)[0] for a in linear], axis=2)
        step = np.linalg.solve(axes, shift[:, :, None])[:, :, 0]
        size = np.linalg.norm(step, axis=1)
        change = np.zeros(n)
        for a in turning:
            change = np.maximum(change, np.abs(turned[a] - moved[a]))
            moved[a] = turned[a]
        for k, a in enumerate(linear):
            moved[a] = moved[a] + step[:, k]
        large = (before > 1e3 * _AT_PLACE) & np.isfinite(before)
        factor[large] = np.maximum(factor[large], size[large] / before[large])
        before = size
        if not np.isfinite(size).all() or size.max(initial=0.0) > _RUNAWAY:
            break
        if size.max(initial=0.0) < _AT_PLACE and change.max(initial=0.0) < _AT_ANGLE:
            at = target.moved(moved)
            return _command(pose.at(at), at, turning, spinning, limited, count, factor)
    raise no_command(machine, target, before)


def _turns(
    found: FoundPose,
    target: Conditions,
    moved: dict[str, F64],
    turning: list[str],
    spinning: frozenset[str],
    machine: Machine,
    most: float,
) -> tuple[dict[str, F64], NDArray[np.bool_]]:
    """By what each rotary axis is to stand elsewhere than at the target, (n,), rad."""
    n = len(found.spin)
    limited = np.zeros(n, dtype=np.bool_)
    turned: dict[str, F64] = {}
    pointing = [a for a in turning if a not in spinning]
    if pointing:
        now = np.stack([moved[a] for a in pointing], axis=1)
        columns = _across(found, pointing)
        need = found.across + np.einsum("nij,nj->ni", columns, now)
        u, s, vt = np.linalg.svd(columns, full_matrices=False)
        share = s / (s**2 + _damping(s) ** 2 + 1e-300)
        along = np.einsum("nij,ni->nj", u, need) * share
        best = np.einsum("nji,nj->ni", vt, along)
        turned = {a: best[:, k] for k, a in enumerate(pointing)}
    for a in turning:
        if a in spinning:
            rotation = found.chain.screw(a)[1]
            about = np.einsum("ni,ni->n", rotation, found.direction)
            first = a == next(b for b in turning if b in spinning)
            turned[a] = moved[a] + found.spin / about if first else moved[a]
    for a in turning:
        low, high = machine.axis(a).travel
        here = target.position(a)
        least = np.maximum(-most, np.minimum(low - here, 0.0))
        greatest = np.minimum(most, np.maximum(high - here, 0.0))
        held = np.clip(turned[a], least, greatest)
        limited |= np.abs(held - turned[a]) > _LEFT
        turned[a] = held
    return turned, limited


def _across(found: FoundPose, axes: list[str]) -> F64:
    """What a unit turn of each axis does to the tool's direction, as turns, (n, 3, axes)."""
    columns = []
    for a in axes:
        rotation = found.chain.screw(a)[1]
        along = np.einsum("ni,ni->n", rotation, found.direction)
        columns.append(rotation - along[:, None] * found.direction)
    return np.stack(columns, axis=2)


def _damping(sine: F64) -> F64:
    """Damping of axes that stand at these sines to the tool: none from `POLE` on, smooth there."""
    return DAMPING * np.maximum(0.0, 1.0 - (sine / POLE) ** 2)


def _command(
    found: FoundPose,
    at: Conditions,
    turning: list[str],
    spinning: frozenset[str],
    limited: NDArray[np.bool_],
    rounds: int,
    factor: F64,
) -> Command:
    left = np.linalg.norm(found.across, axis=1)
    damped = np.zeros(len(left), dtype=np.bool_)
    pointing = [a for a in turning if a not in spinning]
    if pointing:
        sines = np.linalg.svd(_across(found, pointing), compute_uv=False)
        damped = (sines[:, : min(2, len(pointing))].min(axis=1) < POLE) & (left > _LEFT)
    place = np.zeros(len(left))
    return Command(at, left, np.abs(found.spin), place, damped, limited, rounds, factor)


def spinning_axes(machine: Machine, axis: int) -> frozenset[str]:
    """Rotary axes that, wherever the machine stands, only turn the tool about itself."""
    rotary = machine.structure.rotary
    if not rotary:
        return frozenset()
    rng = np.random.default_rng(1954)
    n = 16
    where = {
        a: rng.uniform(*machine.axis(a).travel, n) if a in rotary else np.zeros(n)
        for a in machine.structure.axes
    }
    chain = Chain(machine, Conditions(where))
    tool = chain.orientation[:, :, axis]
    found = {}
    for a in rotary:
        found[a] = float(np.linalg.norm(crossed(chain.screw(a)[1], tool), axis=1).max())
    return frozenset(a for a, sine in found.items() if sine < _SPINS)
