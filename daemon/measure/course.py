"""The course of a measurement: which set-ups and visits are done, what comes next, how long."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby

from abbe.compcore.campaign.campaign import PART
from abbe.compcore.errors import InputError
from abbe.compcore.files.plan_file import PlannedWork
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.visits import SetupVisits
from abbe.daemon.measure.rows import read_back

_REMEMBERED = 8
"""Visits from which the present pace is told."""


class MeasureCourse:
    """The set-ups of a plan and how far each is.

    Parameters
    ----------
    setups
        Those that are measured, in their order.
    within, within_turn
        As `SetupVisits` takes them.
    in_one_go
        Whether a set-up counts only from its first visit to its last with one zero.

    Attributes
    ----------
    visits
        For each set-up.
    parts
        For each set-up, the number of its present zero; 0 before its first row.
    current
        Index of the present set-up.
    """

    def __init__(
        self,
        setups: Sequence[PlannedSetup],
        within: float,
        within_turn: float,
        *,
        in_one_go: bool = False,
    ) -> None:
        self.setups = tuple(setups)
        self._in_one_go = in_one_go
        self.visits = tuple(SetupVisits(s, within, within_turn) for s in setups)
        self.parts = [0] * len(self.setups)
        self.current = 0
        self._left_out: set[int] = set()
        self._intervals: list[float] = []
        self._last = float("nan")

    @property
    def setup(self) -> PlannedSetup:
        """The present set-up."""
        return self.setups[self.current]

    @property
    def here(self) -> SetupVisits:
        """Its visits."""
        return self.visits[self.current]

    @property
    def total(self) -> int:
        """Number of all visits."""
        return sum(v.count for v in self.visits)

    @property
    def done(self) -> int:
        """Number of visits that are done."""
        return self.total - sum(len(v.left) for v in self.visits)

    @property
    def complete(self) -> bool:
        """Whether nothing is left."""
        return not any(v.left for v in self.visits)

    def begin_anew(self, index: int | None = None) -> bool:
        """Take another zero in; whether the set-up has to be measured from its first visit on.

        Parameters
        ----------
        index
            Of the set-up; None: the present one.
        """
        visits = self.here if index is None else self.visits[index]
        if not self._in_one_go or not visits.left or not visits.begun:
            return False
        visits.reopen()
        return True

    def leave_out(self) -> None:
        """Do without the present set-up for now."""
        self._left_out.add(self.current)

    def next_setup(self) -> int | None:
        """The set-up that comes after the present one.

        The next that is not complete; after the last, the first in which something is missing; None
        where there is none, but for those that were left out.
        """
        n = len(self.setups)
        after = [(self.current + k) % n for k in range(1, n + 1)]
        return next((i for i in after if self.visits[i].left and i not in self._left_out), None)

    def missing(self) -> Iterator[tuple[PlannedSetup, list[int]]]:
        """Set-ups and their visits that are not done."""
        for setup, visits in zip(self.setups, self.visits, strict=True):
            if visits.left:
                yield setup, visits.left

    def took(self, time: float) -> None:
        """Note that a visit was done, for the pace; `time` is monotonic, s."""
        planned = self._pace(self.setup)
        if self._last == self._last:
            # setting an instrument up, or a pause, says nothing of the pace
            factor = (time - self._last) / planned
            if factor < 20.0:
                self._intervals = [*self._intervals, factor][-_REMEMBERED:]
        self._last = time

    def paused(self) -> None:
        """Note that what comes next is not of the same pace."""
        self._last = float("nan")

    @property
    def seconds_left(self) -> float:
        """How long it will still take, s."""
        factor = sum(self._intervals) / len(self._intervals) if self._intervals else 1.0
        left = 0.0
        for setup, visits in zip(self.setups, self.visits, strict=True):
            count = len(visits.left)
            left += factor * count * self._pace(setup)
            if count and not visits.begun:
                left += setup.instrument.setup
        return left

    def _pace(self, setup: PlannedSetup) -> float:
        """Planned time from one visit to the next, s."""
        count = max(1, len(setup.visits()[0]))
        return max(1e-3, (setup.seconds - setup.instrument.setup) / count)

    def replay(self, rows: Sequence[Mapping[str, str]], file: object) -> int:
        """Take in the rows of a file that is gone on with.

        Returns
        -------
        How many rows at its end belong to a visit that was not written whole.

        Raises
        ------
        InputError
            For rows that belong to no target of the plan.
        """
        by_name = {s.name: i for i, s in enumerate(self.setups)}
        groups = [list(g) for _, g in groupby(rows, lambda r: (r["time"], r["setup"]))]
        for number, group in enumerate(groups):
            name, _, part = group[0]["setup"].partition(PART)
            index = by_name.get(name)
            visit = None
            if index is not None:
                components = self.setups[index].u.shape[1]
                if number == len(groups) - 1 and len(group) < components:
                    return len(group)
                if int(part or 1) != self.parts[index]:
                    self.begin_anew(index)
                visits = self.visits[index]
                axes = tuple(visits.setup.targets)
                place = {a: read_back(a, group[0][a]) for a in axes}
                came = {a: float(group[0][f"{a}_dir"] or 0.0) for a in axes}
                visit = visits.at(place, came)
            if index is None or visit is None:
                raise InputError(
                    "a row that belongs to no target of the plan",
                    file=str(file),
                    found=f"set-up {group[0]['setup']} at {group[0]['time']} s",
                    expected="the rows as abbe measure wrote them, or another file",
                )
            self.visits[index].take(visit)
            self.parts[index] = int(part or 1)
            self.current = index
        if not self.here.left:
            self.current = self.next_setup() or self.current
        return 0


def chosen(work: PlannedWork, names: Sequence[str], plan: object) -> list[PlannedSetup]:
    """The set-ups of a plan that are to be measured: those that are named, or all.

    Raises
    ------
    InputError
        For a name that the plan does not have.
    """
    known = {s.name for s in work.setups}
    for name in names:
        if name not in known:
            raise InputError(
                "the plan has no such set-up",
                file=str(plan),
                field="setup",
                found=name,
                expected="one of " + ", ".join(s.name for s in work.setups),
            )
    return [s for s in work.setups if not names or s.name in names]
