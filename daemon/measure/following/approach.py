"""The way to the first target of a set-up: where the machine last stood, and what was read there.

Whose unit or sign is another one shows by that way, before anything is kept.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.daemon.config.sections.measure import MeasureSection
from abbe.daemon.measure.following.instrument import Instrument
from abbe.daemon.measure.following.standstill import Standstill
from abbe.daemon.measure.machine_view import SeenMachine

_RESTS = 0.2
"""s without motion after which it stands: less than a program stands beyond a target."""


class Approach:
    """Follows the machine between targets.

    Parameters
    ----------
    limits
        By how much positions vary while it stands.
    axes
        Names, in the machine's order.
    """

    def __init__(self, limits: MeasureSection, axes: Sequence[str]) -> None:
        self._axes = tuple(axes)
        noise = [math.radians(limits.still_turn) if is_rotary(a) else limits.still for a in axes]
        self._standstill = Standstill(noise, _RESTS)

    def step(
        self, seen: SeenMachine, instrument: Instrument, setup: PlannedSetup, *, at_target: bool
    ) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
        """Take a look in; what is read where it stands, less nominal, and what is nominal there.

        None while it moves, stands at a target, or nothing is read.
        """
        if seen.fault:
            self._standstill.forget()
            return None
        stands = self._standstill.step(seen.time, [seen.positions[axis] for axis in self._axes])
        if not stands or at_target or not instrument.values:
            return None
        nominal = instrument.nominal(setup, seen.positions)
        return instrument.deviations(setup, seen.positions), nominal
