"""The nudge before a set-up's first target: whether its instrument shows a small known move.

Sign, unit, frozen, not touching, late by seconds: each shows, before any row is kept. Who was
switched off, or followed by nobody, meanwhile has to show it again, at whichever target it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from abbe.compcore.machine.machine import Machine, nominal_direction
from abbe.compcore.planning.nudge import nudge_of
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.daemon.measure.following.instrument import Instrument

_THERE = 0.3
"""Part of the nudge within which a stand is one of its ends."""
_OFF = 0.25
"""Part of it by which the reading may be off: this is no calibration of the instrument."""
_SURE = 4.0
"""Standard uncertainties of a reading that it may be off by all the same."""


_HARDLY, _FAR = 0.25, 4.0
"""Ratios of what is shown to what was moved, below and above which another unit is likely."""


class NudgeCheck:
    """Holds what is read at the end of the nudge against what is read at its target.

    Parameters
    ----------
    machine
        The machine.
    amount
        The plan's nudge, mm; 0: none is made.

    Attributes
    ----------
    follows
        Whether the instrument was seen to show what axes across the line move.
    problem
        Why nothing counts until it does; empty where it does, or nothing is known of it.
    """

    def __init__(self, machine: Machine, amount: float) -> None:
        self._machine = machine
        self._amount = amount
        self.forget()

    def forget(self) -> None:
        """Turn to another set-up, or to an instrument that may be another one now."""
        self._at_end: tuple[tuple[float, ...], tuple[float, ...]] | None = None
        self._target: int | None = None
        self.follows = False
        self.problem = ""

    def wanted(self, setup: PlannedSetup) -> dict[str, float]:
        """Axis → mm of the nudge of a set-up; empty where it has none."""
        return nudge_of(self._machine, setup, self._amount)

    def awaited(self, setup: PlannedSetup, target: int) -> bool:
        """Whether a stand at a target may be one of the nudge: at the first, or if none was seen.

        The axes that it moves stand still along the line: at every target they are as at the first.
        """
        return bool(self.wanted(setup)) and (target == 0 or not self.follows)

    def aside(self, setup: PlannedSetup, place: Mapping[str, float]) -> tuple[float, ...]:
        """What a stand at a target shows by being aside of the line, by direction, mm."""
        off = np.zeros(3)
        for axis in self.wanted(setup):
            off += (place[axis] - float(setup.targets[axis][0])) * np.asarray(
                nominal_direction(axis)
            )
        u = setup.u[0] / np.linalg.norm(setup.u[0], axis=1)[:, None]
        return tuple(float(x) for x in u @ off)

    def turning(self, setup: PlannedSetup, place: Mapping[str, float]) -> bool:
        """Whether a stand is at either end of the nudge."""
        return self._at(setup, place, 1.0) or self._at(setup, place, -1.0)

    def take_end(
        self,
        setup: PlannedSetup,
        target: int,
        place: Mapping[str, float],
        values: Sequence[float],
    ) -> bool:
        """Take a stand in that is an end of the nudge, and no target; whether it is the far end."""
        if not self._at(setup, place, 1.0):
            return False
        self._at_end, self.follows = (tuple(values), self.aside(setup, place)), False
        self._target = target
        return True

    def judge(
        self,
        setup: PlannedSetup,
        target: int,
        instrument: Instrument,
        place: Mapping[str, float],
        values: Sequence[float],
    ) -> str:
        """Hold its target against the end of the nudge; what is to be said, or empty.

        At another target optics that stand askew would show that, too.
        """
        if self._at_end is None or self.follows or target != self._target:
            return ""
        shown, aside = self._at_end
        moved = [a - b for a, b in zip(aside, self.aside(setup, place), strict=True)]
        read = [a - b for a, b in zip(shown, values, strict=True)]
        allowed = max(_OFF * max(map(abs, moved)), _SURE * instrument.sd(setup, target))
        self.follows = all(abs(r - m) <= allowed for r, m in zip(read, moved, strict=True))
        words = ", ".join(f"{r:+.4f}" for r in read)
        wanted = ", ".join(f"{m:+.4f}" for m in moved)
        if self.follows:
            self.problem = ""
            return (
                f"{instrument.name} follows: it shows {words} mm where the machine has moved by "
                f"{wanted} mm across the line"
            )
        self.problem = (
            f"shows {words} mm where the machine has moved by {wanted} mm across the line: "
            f"{_why(read, moved)}; set right, begin the program of this set-up again"
        )
        return ""

    def problem_at(self, target: int) -> str:
        """The problem, whole at the target where it was seen."""
        return self.problem if target == self._target else "was not seen to follow the machine yet"

    def _at(self, setup: PlannedSetup, place: Mapping[str, float], sense: float) -> bool:
        wanted = self.wanted(setup)
        return bool(wanted) and all(
            abs(place[a] - float(setup.targets[a][0]) - sense * by) <= _THERE * abs(by)
            for a, by in wanted.items()
        )


def _why(read: Sequence[float], moved: Sequence[float]) -> str:
    """What it comes from that an instrument shows something else than the machine has moved by."""
    k = max(range(len(moved)), key=lambda i: abs(moved[i]))
    ratio = read[k] / moved[k]
    if abs(25.4 * ratio - 1.0) <= _OFF:
        return "it shows a twenty-fifth: is its display switched to inches?"
    if abs(ratio) < _HARDLY:
        return (
            "does it touch, is it late by seconds ([measure] settle has to be longer than that), "
            "or is its unit another one?"
        )
    if abs(ratio + 1.0) <= _OFF:
        return "its sign is turned (sign = -1, or 1)"
    if abs(ratio) > _FAR:
        return "it is read in another unit than its own"
    return "is it late by seconds ([measure] settle has to be longer than that), or set up askew?"
