"""Targets along axes: by the rule of steps, and never fewer than the model has unknowns there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.calibrated_gauge import CalibratedGauge
from abbe.compcore.artefacts.calibrated_plate import CalibratedPlate
from abbe.compcore.campaign.plan import line_steps
from abbe.compcore.campaign.sampling import HELD
from abbe.compcore.machine.machine import Axis, Machine
from abbe.compcore.model.model import Model
from abbe.compcore.planning.envelope import WorkingSpace

F64 = NDArray[np.float64]
Place = tuple[float, float, float]

_PER_UNKNOWN = 1.5
"""Targets along an axis for each unknown of the shape with the most of them."""
_EDGE = 0.01
"""Part of the travel that is left free at each end, for coming from both sides."""


@dataclass(frozen=True, eq=False)
class SurveyTask:
    """What set-ups are planned for.

    Attributes
    ----------
    model
        The machine and the effects that are to be determined.
    space
        Where the machine may go.
    tools
        Name → offset, mm; the first is the usual one.
    waves
        Axis → the shortest wave that is to be seen, mm or rad.
    held
        Part of its amplitude that a table shall hold.
    plate
        The ball plate at hand that the machine touches itself; None: any of 5 × 5 balls.
    gauge
        The gauge block or step gauge at hand, likewise; None: any, along lines.
    along_axes
        Only set-ups in which one axis moves: as files of instruments that are not linked have them.
    """

    model: Model
    space: WorkingSpace = field(default_factory=WorkingSpace)
    tools: Mapping[str, Place] = field(default_factory=lambda: {"T1": (0.0, 0.0, -100.0)})
    waves: Mapping[str, float] = field(default_factory=dict)
    held: float = HELD
    plate: CalibratedPlate | None = None
    gauge: CalibratedGauge | None = None
    along_axes: bool = False

    @property
    def machine(self) -> Machine:
        """The machine."""
        return self.model.machine

    def standing(self, parts: Mapping[str, float] | None = None) -> dict[str, float]:
        """Where axes stand that do not move, mm or rad.

        Parameters
        ----------
        parts
            Axis → part of its usable travel, 0 … 1; others stand in the middle, rotary axes at 0
            where they reach it.
        """
        found = {}
        for name, axis in self.machine.axes.items():
            if parts is not None and name in parts:
                found[name] = self.at(name, parts[name])
            elif axis.rotary or name[0] not in "XYZ":
                found[name] = float(axis.clamp(np.zeros(1))[0])
            else:
                found[name] = axis.middle
        return found

    def ends(self, name: str) -> tuple[float, float]:
        """The travel of an axis less what is needed to come from both sides, mm or rad."""
        axis = self.machine.axes[name]
        if axis.rotary:
            edge = math.radians(0.1 * self.space.beyond + 0.01)
        else:
            edge = max(self.space.beyond, _EDGE * 2.0 * axis.half_travel)
            edge = min(edge, 0.25 * axis.half_travel)
        return axis.travel[0] + edge, axis.travel[1] - edge

    def at(self, name: str, part: float) -> float:
        """A position by its part of the usable travel, 0 … 1, mm or rad."""
        low, high = self.ends(name)
        return low + part * (high - low)

    def count(self, name: str, *, moves: bool = True) -> int:
        """Targets over the whole travel of an axis; where it does not `move` it shows no wave."""
        axis = self.machine.axes[name]
        steps = line_steps(axis, self.waves.get(name) if moves else None, self.held)[0]
        return max(steps.targets, math.ceil(_PER_UNKNOWN * self._unknowns(axis)) + 1)

    def fine(self, name: str) -> tuple[float, float, int] | None:
        """First, last and number of targets of a short line that shows a wave; None: none needed.

        mm or rad.
        """
        steps = line_steps(self.machine.axes[name], self.waves.get(name), self.held)
        if len(steps) < 2:
            return None
        return (
            steps[1].first,
            steps[1].first + steps[1].step * (steps[1].targets - 1),
            steps[1].targets,
        )

    def _unknowns(self, axis: Axis) -> int:
        most = 0
        for effect in self.model.effects:
            if effect.positions_used(self.machine) == (axis.name,):
                own = effect.linear(self.machine)
                motions = len({p.name.split(" ")[0] for p in own}) or 1
                most = max(most, motions)
        return most
