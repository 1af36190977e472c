"""A target: the machine comes to rest there, settles, is read, and leaves."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.visits import SetupVisits
from abbe.daemon.config.sections.measure import MeasureSection
from abbe.daemon.measure.following.afterwards import Afterwards
from abbe.daemon.measure.following.average import Averaging, SteadyReading, unsteady
from abbe.daemon.measure.following.instrument import Instrument
from abbe.daemon.measure.following.liveliness import InstrumentLiveliness
from abbe.daemon.measure.following.standstill import Standstill
from abbe.daemon.measure.machine_view import SeenMachine, missing_signal

_ELSEWHERE = 3.0
"""s of standing at no target after which that is said."""
_SPREAD = 3.0
"""µm or µrad by which readings of an instrument that is surer than that may scatter."""
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?")
"""What differs from time to time where the same is in the way."""
_UNSEEN = "this computer was too busy to see from which side it came"


@dataclass(frozen=True, slots=True)
class TargetRead:
    """A target was read: which visit, and what."""

    visit: int
    reading: SteadyReading


@dataclass(frozen=True, slots=True)
class TargetUnsteady:
    """At a visit readings do not count yet: ``spread``, ``drift``, or what is missing."""

    visit: int
    why: str
    reading: SteadyReading | None = None


@dataclass(frozen=True, slots=True)
class TargetChanged:
    """What was read at a visit has changed since, by so much (mm, rad), so long after it stood (s).

    It is read again.
    """

    visit: int
    by: float
    after: float


@dataclass(frozen=True, slots=True)
class TargetLeft:
    """The machine left a visit before it was read, and what had been in the way."""

    visit: int
    why: str


@dataclass(frozen=True, slots=True)
class StandsElsewhere:
    """The machine stands where no target is."""


Outcome = TargetRead | TargetUnsteady | TargetChanged | TargetLeft | StandsElsewhere | None


class TargetWatch:
    """Follows the machine from target to target.

    Parameters
    ----------
    limits
        When it stands, and when a reading counts.
    axes
        Names, in the machine's order.
    """

    def __init__(self, limits: MeasureSection, axes: Sequence[str]) -> None:
        self._limits = limits
        self._axes = tuple(axes)
        noise = [math.radians(limits.still_turn) if is_rotary(a) else limits.still for a in axes]
        self._standstill = Standstill(noise, limits.still_for)
        turn = math.radians(limits.within_turn)
        self._within = [turn if is_rotary(a) else limits.within for a in axes]
        self._old_place: Sequence[float] | None = None
        self._visit: int | None = None
        self._done = False
        self._why = ""
        self._said: set[str] = set()
        self._elsewhere = False
        self._came: dict[str, float] = {}
        self._averaging = Averaging(0.0, limits.average)
        self._lively = InstrumentLiveliness()
        self._afterwards = Afterwards(limits)
        self._settle = limits.settle
        self._arrived = 0.0
        self._interruptions = 0

    @property
    def at(self) -> int | None:
        """The visit at which the machine stands; None: at none."""
        return self._visit

    @property
    def not_come(self) -> bool:
        """Whether it still stands where it stood when it turned to this set-up."""
        return self._old_place is not None

    def forget(self, seen: SeenMachine | None = None) -> None:
        """Begin anew, with another set-up.

        Parameters
        ----------
        seen
            The machine as it stands with what was set up before: there nothing is read until it
            has moved; None: where it stands now is looked at again.
        """
        self._old_place = None if seen is None else [seen.positions[a] for a in self._axes]
        self._visit, self._done, self._why, self._elsewhere = None, False, "", False
        self._standstill.forget()
        self._lively = InstrumentLiveliness()
        self._settle = self._limits.settle
        self._afterwards.forget()

    def step(self, seen: SeenMachine, instrument: Instrument, visits: SetupVisits) -> Outcome:
        """Take a look in; what has come of it."""
        if seen.fault:
            # for a moment nobody knows where it is: what was read so far does not count
            if self._visit is None:
                self._standstill.forget()
            elif not self._done:
                self._begin(seen.time + self._settle)
            return None
        positions = [seen.positions[axis] for axis in self._axes]
        stands = self._standstill.step(seen.time, positions)
        if self._old_place is not None:
            ways = zip(positions, self._old_place, self._within, strict=True)
            if all(abs(q - old) <= within for q, old, within in ways):
                return None
            self._old_place = None
        counts = stands and self._visit is not None and not self._done
        settled = counts and instrument.time >= self._averaging.begins
        self._lively.add(instrument.time, instrument.values, stands=settled)
        if not stands:
            left = None
            if self._visit is not None and not self._done:
                left = TargetLeft(self._visit, self._why or "too short a stop")
            self._visit, self._done, self._why, self._elsewhere = None, False, "", False
            return left
        if self._done and visits.turned(self._came, seen.directions):
            # away and back from the other side between two looks
            self._visit, self._done, self._why = None, False, ""
        if self._done:
            return self._look_after(seen, instrument, visits)
        if self._visit is None:
            return self._arrive(seen, visits)
        return self._read(seen, instrument, visits)

    def _arrive(self, seen: SeenMachine, visits: SetupVisits) -> Outcome:
        self._visit = visits.at(seen.positions, seen.directions)
        self._arrived = seen.time
        self._afterwards.forget()
        if self._visit is not None:
            self._said.clear()
            self._came = dict(seen.directions)
            if unseen := sorted(seen.unseen & visits.told_by_direction):
                self._done = True
                return TargetLeft(self._visit, f"{', '.join(unseen)}: {_UNSEEN}")
            self._begin(seen.time + self._settle)
            return None
        if self._elsewhere or seen.time - self._standstill.since < _ELSEWHERE:
            return None
        self._elsewhere = True
        return StandsElsewhere()

    def _begin(self, time: float) -> None:
        self._averaging = Averaging(time, self._limits.average)

    def _read(self, seen: SeenMachine, instrument: Instrument, visits: SetupVisits) -> Outcome:
        assert self._visit is not None  # noqa: S101 - `step` saw to it
        if instrument.problem and instrument.there:
            # an answer that cannot be read takes nothing from those that can
            return self._say(instrument.problem)
        if instrument.interruptions != self._interruptions:
            self._interruptions = instrument.interruptions
            self._begin(seen.time + self._settle)
        missing = instrument.problem or missing_signal(seen, self._limits.signals_held)
        if not missing and self._lively.frozen:
            missing = f"{instrument.name} reads the very same again and again: does it measure?"
        if missing:
            self._begin(seen.time + self._settle)
            return self._say(missing)
        setup, limits = visits.setup, self._limits
        self._averaging.add(
            instrument.time,
            instrument.deviations(setup, seen.positions),
            [seen.positions[axis] for axis in self._axes],
        )
        if not self._averaging.full(seen.time):
            return None
        found = self._averaging.result()
        unit = 1e-6 if instrument.angle else 1e-3
        if limits.max_spread is None:
            stated = instrument.sd(setup, int(visits.order[self._visit]))
            spread = max(_SPREAD * unit, stated)
        else:
            spread = limits.max_spread * unit
        why = unsteady(found, limits.max_drift * unit, spread)
        if why:
            self._begin(seen.time)
            return self._say(why, found)
        self._done = True
        if instrument.section.reads != "length":  # of which the next target tells more
            self._afterwards.begin(found, seen.time)
        return TargetRead(self._visit, found)

    def _look_after(
        self, seen: SeenMachine, instrument: Instrument, visits: SetupVisits
    ) -> Outcome:
        """Look whether what was read has changed; then it is read again, and later from now on."""
        assert self._visit is not None  # noqa: S101 - as above
        if instrument.problem or not instrument.section.linked:
            self._afterwards.forget()
            return None
        by = self._afterwards.step(
            seen.time, instrument, visits.setup, int(visits.order[self._visit]),
            instrument.deviations(visits.setup, seen.positions),
            [seen.positions[axis] for axis in self._axes],
        )  # fmt: skip
        if not by:
            return None
        after = seen.time - self._arrived
        self._settle = max(self._settle, after)
        self._done, self._why = False, "it still changed"
        self._afterwards.forget()
        self._begin(seen.time)
        return TargetChanged(self._visit, by, after)

    def _say(self, why: str, reading: SteadyReading | None = None) -> Outcome:
        assert self._visit is not None  # noqa: S101 - as above
        self._why = why
        bare = _NUMBER.sub("", why)
        if bare in self._said:
            return None
        self._said.add(bare)
        return TargetUnsteady(self._visit, why, reading)
