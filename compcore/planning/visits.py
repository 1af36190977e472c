"""Visits of a set-up's targets, recognised by where the machine stands and from where it came."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.units import in_digits

F64 = NDArray[np.float64]


class SetupVisits:
    """The visits of one set-up's targets: which are done, and which one it is now.

    A machine that leaves targets out, repeats some or begins a run anew is followed: of all visits
    that fit to where it stands, the one nearest to what was expected is meant.

    Parameters
    ----------
    setup
        The set-up.
    within, within_turn
        How far from a target a machine may stand that is meant to be there, mm and rad.

    Attributes
    ----------
    order, sense
        Target of each visit, and the run's sense, as `PlannedSetup.visits`.
    expected
        The visit that comes next where nothing is left out; `count` after the last.

    Raises
    ------
    InputError
        Where targets are so near to one another that they could be taken for each other.
    """

    def __init__(self, setup: PlannedSetup, within: float, within_turn: float) -> None:
        self.setup = setup
        self.order, self.sense = setup.visits()
        self.expected = 0
        self._taken = np.zeros(len(self.order), dtype=np.bool_)
        axes = tuple(setup.targets)
        self._axes = axes
        self._at = np.stack([setup.targets[a] for a in axes], axis=1)
        self._within = np.array([within_turn if is_rotary(a) else within for a in axes])
        moving = np.ptp(self._at, axis=0) > 0.0
        senses = setup.senses()
        # one way only: a target that is met from the other side is still that target
        self._senses = {
            a: senses[a] for a, moves in zip(axes, moving, strict=True) if moves and setup.both_ways
        }
        self._check_apart(within)

    def _check_apart(self, within: float) -> None:
        scaled = self._at / self._within
        for k in range(len(scaled)):
            others = np.abs(scaled[k + 1 :] - scaled[k]).max(axis=1, initial=0.0)
            near = (others < 2.0) & (others > 0.0)
            if len(others) and near.any():
                most = 0.5 * within * float(others[near].min())
                raise InputError(
                    f"targets {k + 1} and {k + 2 + int(np.argmax(near))} of set-up "
                    f"{self.setup.name} are nearer to each other than twice the distance within "
                    "which a target is recognised",
                    field="measure.within",
                    found=within,
                    expected=f"less than {in_digits(most, 4)} mm",
                )

    @property
    def count(self) -> int:
        """Number of visits."""
        return len(self.order)

    @property
    def told_by_direction(self) -> frozenset[str]:
        """Axes whose direction tells two visits of one target from each other."""
        return frozenset(self._senses)

    @property
    def left(self) -> list[int]:
        """Visits that are not done."""
        return [int(i) for i in np.flatnonzero(~self._taken)]

    @property
    def begun(self) -> bool:
        """Whether any visit is done."""
        return bool(self._taken.any())

    def taken(self, visit: int) -> bool:
        """Whether a visit is done."""
        return bool(self._taken[visit])

    def at(self, positions: Mapping[str, float], directions: Mapping[str, float]) -> int | None:
        """The visit that is meant where a machine stands; None: at none of the targets.

        Parameters
        ----------
        positions
            Axis → position, mm or rad.
        directions
            Axis → direction in which it arrived, 1, −1, or 0 where that is not known.
        """
        here = np.array([positions[a] for a in self._axes])
        near = (np.abs(self._at - here) <= self._within).all(axis=1)
        fits = near[self.order]
        for axis, sense in self._senses.items():
            came = directions.get(axis, 0.0)
            if came:
                fits &= sense == came
        found = np.flatnonzero(fits)
        if not len(found):
            return None
        away = np.abs(found - self.expected) + np.where(found < self.expected, 0.5, 0.0)
        return int(found[int(np.argmin(away))])

    def turned(self, came: Mapping[str, float], now: Mapping[str, float]) -> bool:
        """Whether the directions (1, −1) tell another visit now than when the machine `came`."""
        return any(now.get(a) and now[a] != came.get(a) for a in self._senses)

    def take(self, visit: int) -> list[int]:
        """Note that a visit is done; the visits that were left out just before it."""
        left_out = [i for i in range(self.expected, visit) if not self._taken[i]]
        self._taken[visit] = True
        self.expected = visit + 1
        return left_out

    def give_back(self, visit: int) -> None:
        """Note that a visit that was done is not, and is the one that comes next."""
        self._taken[visit] = False
        self.expected = visit

    def reopen(self) -> None:
        """Begin anew: no visit is done."""
        self._taken[:] = False
        self.expected = 0

    def distance(self, positions: Mapping[str, float]) -> float:
        """How far the linear axes are from the visit that is expected, mm; 0 after the last."""
        if self.expected >= self.count:
            return 0.0
        target = self._at[self.order[self.expected]]
        ways = [
            positions[a] - t for a, t in zip(self._axes, target, strict=True) if not is_rotary(a)
        ]
        return float(np.linalg.norm(ways))

    def turn(self, positions: Mapping[str, float]) -> float:
        """How far the rotary axis that has most to turn is from it, rad; 0 after the last."""
        if self.expected >= self.count:
            return 0.0
        target = self._at[self.order[self.expected]]
        ways = [
            abs(positions[a] - t) for a, t in zip(self._axes, target, strict=True) if is_rotary(a)
        ]
        return float(max(ways, default=0.0))

    def target(self, visit: int) -> dict[str, float]:
        """Axis → where it stands at a visit, mm or rad."""
        return dict(zip(self._axes, self._at[self.order[visit]].tolist(), strict=True))
