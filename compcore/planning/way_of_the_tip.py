"""The way of a tool's tip: straight by linear axes, on arcs by an arm's joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.figures.places import reaches_by_joints
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.planned_setup import tip_at

F64 = NDArray[np.float64]

_TURN = np.radians(1.0)
"""rad that a joint turns between two places of an arc: 0.08 mm beside it at a reach of 2 m."""


def way_of_the_tip(machine: Machine, targets: Mapping[str, F64], offset: Sequence[float]) -> F64:
    """Where the tip is on the way through some targets, straight lines between, (m, 3), mm.

    `tip_at` each target; where joints take the tip there all axes move together, with as many
    places between two targets as the arcs need.

    Parameters
    ----------
    targets, offset
        As in `tip_at`.
    """
    return tip_at(machine, _between(targets) if reaches_by_joints(machine) else targets, offset)


def _between(targets: Mapping[str, F64]) -> dict[str, F64]:
    """Some targets and places between them, no joint turning more than a little from one to next.

    Parameters
    ----------
    targets
        As in `way_of_the_tip`.
    """
    count = max((len(q) for q in targets.values()), default=0)
    turned = [np.abs(np.diff(q)) for a, q in targets.items() if is_rotary(a)]
    most = np.max(turned, axis=0) if turned else np.zeros(max(count - 1, 0))
    cuts = np.maximum(1, np.ceil(most / _TURN)).astype(np.int64)
    parts = [n + np.arange(c) / c for n, c in enumerate(cuts.tolist())]
    where = np.concatenate([*parts, [count - 1.0]])
    among = np.arange(count)
    return {a: np.interp(where, among, q) for a, q in targets.items()}


def length_of_the_tool(
    machine: Machine, targets: Mapping[str, F64], offset: Sequence[float]
) -> F64:
    """How far from its tip a tool reaches, mm: to the spindle, of an arm to its last joint.

    (m, 1), at each place of `way_of_the_tip`; (1, 1) where it is the same at all of them.

    Parameters
    ----------
    targets, offset
        As in `way_of_the_tip`.
    """
    reach = np.asarray(offset, dtype=np.float64)[None, :]
    if not reaches_by_joints(machine):
        return np.asarray(np.linalg.norm(reach, axis=1, keepdims=True))
    side = machine.structure.tool_side
    last = max(n for n, a in enumerate(side) if machine.axis(a).rotary)
    reach = reach - np.asarray(machine.axis(side[last]).location)
    beyond = [a for a in side[last + 1 :] if a in targets]
    at = _between(targets) if beyond else {}
    for axis in beyond:
        reach = reach + np.outer(at[axis], machine.axis(axis).direction)
    return np.asarray(np.linalg.norm(reach, axis=1, keepdims=True))
