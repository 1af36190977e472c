"""Where the machine may go: travels, keep-out boxes, and the tool that must not touch them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.figures.places import reaches_by_joints
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.drawing_back import drawn_back
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.probing.room import hindered
from abbe.compcore.planning.way_of_the_tip import length_of_the_tool, way_of_the_tip

F64 = NDArray[np.float64]

_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class KeepOut:
    """A box that neither the tool's tip nor the tool may enter; mm, as X, Y, Z + tool count.

    On a machine whose joints take the tool there: in the machine's axes, as its model has them.

    Attributes
    ----------
    low, high
        Its corners.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class WorkingSpace:
    """Where a plan may send a machine.

    Attributes
    ----------
    keep_out
        Boxes that the tool must not enter.
    radius
        Of the tool with its holder, mm: the tool reaches from its tip to the spindle.
    beyond
        How far axes go beyond a target to come back to it from the other side, mm; rotary axes the
        same number of degrees / 10.
    nudge
        How far axes across a line move before its first target and come back, mm, so that its
        instrument is seen to follow; 0: not.
    table
        Radius of the rotary table with all that is on it lower than a sphere that is touched, mm;
        0: not known.
    """

    keep_out: tuple[KeepOut, ...] = ()
    radius: float = 0.0
    beyond: float = 2.0
    nudge: float = 0.0
    table: float = 0.0

    def hindrance(self, machine: Machine, setup: PlannedSetup) -> str | None:
        """Why a set-up cannot be done, or None: targets outside the travels, ways through a box."""
        senses = setup.senses()
        order, _ = setup.visits()
        for axis, at in setup.targets.items():
            own = machine.axes[axis]
            more = np.radians(0.1 * self.beyond) if own.rotary else self.beyond
            before = at[order] - senses[axis] * (more if np.ptp(at) > 0.0 else 0.0)
            low, high = min(before.min(), at.min()), max(before.max(), at.max())
            if low < own.travel[0] - _ROUNDING or high > own.travel[1] + _ROUNDING:
                return f"{axis} would leave its travel"
        if setup.instrument.key == "sphere":
            hindered, why = self.cannot_touch(machine, setup.targets, setup.offset)
            if hindered.any():
                return why
        turns = any(np.ptp(q) > 0.0 for a, q in setup.targets.items() if is_rotary(a))
        visited = {a: q[order] for a, q in setup.targets.items()}
        hit = self.entered(machine, visited, setup.offset, turns=turns)
        return None if hit is None else f"the tool would enter keep-out box {hit}"

    def cannot_touch(
        self, machine: Machine, targets: Mapping[str, F64], offset: Sequence[float]
    ) -> tuple[NDArray[np.bool_], str]:
        """As `hindered`, in this space."""
        back = drawn_back(machine, offset)
        return hindered(machine, targets, offset, back, self.table, self.radius)

    def entered(
        self,
        machine: Machine,
        targets: Mapping[str, F64],
        offset: Sequence[float],
        *,
        turns: bool,
    ) -> int | None:
        """The number of the first keep-out box that a tool enters on its way, from 1; None: none.

        Of an arm the tool up to its last joint counts, not what carries that joint.

        Parameters
        ----------
        targets
            Axis → where it stands at each place of the way, (k,), mm or rad; all move together.
        offset
            The tool's, mm.
        turns
            Whether rotary axes turn meanwhile.
        """
        if not self.keep_out:
            return None
        way = way_of_the_tip(machine, targets, offset)
        swung = length_of_the_tool(machine, targets, offset)
        anyhow = turns or reaches_by_joints(machine)
        for i, box in enumerate(self.keep_out, start=1):
            if self._enters(way, box, np.asarray(offset), swung if anyhow else None):
                return i
        return None

    def _enters(self, way: F64, box: KeepOut, offset: F64, swung: F64 | None) -> bool:
        """Whether tip or tool enter a box on the way: the box is widened by the tool instead.

        swung: how far the tool reaches from its tip, (m, 1) or (1, 1), mm, where it may point
        anywhere; else None.
        """
        low = np.asarray(box.low) - np.maximum(-offset, 0.0) - self.radius
        high = np.asarray(box.high) - np.minimum(-offset, 0.0) + self.radius
        if swung is not None:
            reach = swung + self.radius
            if len(reach) > 1:  # on each piece of the way the longer of its two ends
                reach = np.maximum(reach[:-1], reach[1:])
            low, high = np.asarray(box.low) - reach, np.asarray(box.high) + reach
        low, high = low - self.beyond, high + self.beyond
        start, move = way[:-1], np.diff(way, axis=0)
        if not len(move):
            start, move = way, np.zeros_like(way)
        still = np.abs(move) < 1e-12
        step = np.where(still, 1.0, move)
        one, two = (low - start) / step, (high - start) / step
        inside = (start >= low) & (start <= high)
        enter = np.where(still, np.where(inside, -np.inf, np.inf), np.minimum(one, two))
        leave = np.where(still, np.where(inside, np.inf, -np.inf), np.maximum(one, two))
        return bool(
            (np.maximum(enter.max(axis=1), 0.0) <= np.minimum(leave.min(axis=1), 1.0)).any()
        )
