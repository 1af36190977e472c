"""What a tracker beside an arm sees of its tip, and the links that are in the way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.machine.machine import Machine
from abbe.compcore.planning.planned_setup import tip_at

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

_THICK = 0.05
"""Radius of a link, part of the arm's reach; a wrist is thinner: …"""
_OF_THE_WAY = 0.3
"""… at most this part of how far the tip is usually from it."""
_TINY = 1e-12
_SAME_PLACE = 1e-6
"""mm."""


class Links:
    """The links of an arm at some poses, as lines from each joint of the tool's side to the next.

    Nothing else is known of an arm's body: a joint's place in the model is a point of its line.

    Parameters
    ----------
    targets
        Axis → its positions, (k,), mm or rad; all axes.
    reach
        How far the tip goes, mm.
    """

    def __init__(
        self,
        machine: Machine,
        targets: Mapping[str, F64],
        offset: Sequence[float],
        reach: float,
    ) -> None:
        side = machine.structure.tool_side
        self.tip = tip_at(machine, targets, offset)
        joints = []
        for k, axis in enumerate(side):
            if machine.axes[axis].rotary:
                # what a joint turns is not its own place, and what comes behind it is beyond
                before = {a: np.zeros_like(q) if a in side[k:] else q for a, q in targets.items()}
                joints.append(tip_at(machine, before, machine.axis(axis).location))
        self._joints = joints
        way = [float(np.median(d)) for d in (self._away(self.tip, i) for i in self._numbers)]
        self._thick = [min(_THICK * reach, _OF_THE_WAY * d) for d in way]

    def seen_from(self, place: F64) -> Bool:
        """At which poses no link stands between the tip and a place, (k,)."""
        start = np.broadcast_to(place, self.tip.shape)
        return self._clear(start, self.tip, self._numbers)

    def apart(self) -> Bool:
        """At which poses the tool keeps clear of the links, (k,), but of that at which it begins.

        Where the lines of a wrist meet in one point, the tool begins at the end of the forearm.
        """
        if not self._joints:
            return np.array(True)
        wrist = self._joints[-1]
        ends = [np.abs(self._joints[i + 1] - wrist).max() < _SAME_PLACE for i in self._numbers]
        counted = [
            i for i, at_the_wrist in zip(self._numbers, ends, strict=True) if not at_the_wrist
        ]
        return self._clear(wrist, self.tip, counted)

    @property
    def _numbers(self) -> range:
        return range(max(len(self._joints) - 2, 0))

    def _away(self, points: F64, i: int) -> F64:
        return between(points, points, self._joints[i], self._joints[i + 1])

    def _clear(self, start: F64, end: F64, numbers: Sequence[int]) -> Bool:
        free = np.ones(len(end), dtype=np.bool_)
        for i in numbers:
            free &= between(start, end, self._joints[i], self._joints[i + 1]) > self._thick[i]
        return free


def between(start: F64, end: F64, first: F64, second: F64) -> F64:
    """The shortest distance between two straight pieces, row by row, (k,).

    Ericson, *Real-Time Collision Detection*, 5.1.9.

    >>> between(*(np.array([p], float) for p in ([0, 0, 0], [9, 0, 0], [3, 4, -1], [3, 4, 1])))
    array([4.])
    """
    one, two, gap = end - start, second - first, start - first
    a, e, f = (np.einsum("ij,ij->i", u, v) for u, v in ((one, one), (two, two), (two, gap)))
    b, c = (np.einsum("ij,ij->i", one, v) for v in (two, gap))
    flat = a * e - b * b
    s = np.where(flat > _TINY * a * e, (b * f - c * e) / np.where(flat > 0.0, flat, 1.0), 0.0)
    s = np.clip(s, 0.0, 1.0)
    t = np.clip((b * s + f) / np.where(e > 0.0, e, 1.0), 0.0, 1.0)
    s = np.clip((b * t - c) / np.where(a > 0.0, a, 1.0), 0.0, 1.0)
    apart = start + s[:, None] * one - first - t[:, None] * two
    return np.asarray(np.linalg.norm(apart, axis=1))
