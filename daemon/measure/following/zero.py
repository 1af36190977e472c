"""The zero from which an instrument counts in a set-up, and its being another one."""

from __future__ import annotations

from collections.abc import Sequence

from abbe.compcore.campaign.campaign import Kind
from abbe.daemon.measure.course import MeasureCourse
from abbe.daemon.measure.following.average import SteadyReading
from abbe.daemon.measure.following.doubtful import (
    RepeatedTargets,
    SameReadings,
    TinyReadings,
    known_fault,
    not_followed,
    other_unit,
    size_words,
)
from abbe.daemon.measure.following.instrument import Instrument
from abbe.daemon.measure.news import MeasureNews
from abbe.daemon.measure.rows import part_name

_SURE = 20.0
"""Scatters of an unsteady reading that a difference has to be, to say anything."""


class InstrumentZero:
    """The zero of the present set-up; each new one begins a part of it in the campaign.

    Parameters
    ----------
    course
        How far the measurement is; its parts are counted here.
    news
        Is told of readings that have jumped, and of those that cannot be this machine's.

    Attributes
    ----------
    renew
        Whether the next reading counts from another zero.
    perhaps_lost
        Part of the campaign → times of its rows, s, from each of which on they may count from
        elsewhere; to be said in the file with the next row, and then cleared.
    """

    renew: bool
    perhaps_lost: dict[str, list[float]]

    def __init__(self, course: MeasureCourse, news: MeasureNews) -> None:
        self._course = course
        self._news = news
        self._repeated = RepeatedTargets()
        self._same = SameReadings()
        self._tiny = TinyReadings()
        self.forget()

    def forget(self) -> None:
        """Turn to another set-up."""
        self._zero: tuple[float, ...] = ()
        self._before: tuple[float, ...] = ()
        self._nominal: tuple[float, ...] = ()
        self._unsteady: tuple[tuple[float, ...], tuple[float, ...]] | None = None
        self._rest: tuple[tuple[float, ...], tuple[float, ...]] | None = None
        self._broken = False
        self._doubted: int | None = None
        self._first = False
        self.renew = False
        self.perhaps_lost = {}
        self._repeated.forget()
        self._same.forget()
        self._tiny.forget()

    def rested(self, values: tuple[float, ...], nominal: tuple[float, ...]) -> None:
        """Note what was read where the machine stood on its way to a target; as of `less`."""
        self._rest = values, nominal

    def withdraw(self) -> None:
        """Forget the target that counted last."""
        self._repeated.withdraw()
        self._tiny.forget()
        self._same.forget()

    def interrupted(self, *, counts: bool) -> None:
        """Note that the instrument was: what follows may count from elsewhere.

        Parameters
        ----------
        counts
            Whether rows are there that count from the zero before.
        """
        self.renew = self.renew or counts
        self._unsteady = self._rest = None

    def look(
        self,
        instrument: Instrument,
        reading: SteadyReading,
        nominal: tuple[float, ...],
        visit: int,
    ) -> None:
        """Say where readings that are not steady, and not kept, are in another unit.

        Whose unit is another one scatters by as much more, and would never count.

        Parameters
        ----------
        reading
            Less `nominal`, of the target where the machine stands.
        nominal, visit
            As of `less`.
        """
        setup = self._course.setup
        scatter = max([*reading.spreads, *(abs(d) for d in reading.drifts)], default=0.0)
        problem = ""
        if setup.kind == Kind.DISTANCE:
            if max(abs(v) for v in reading.values) > _SURE * scatter:
                problem = other_unit(reading.values, nominal)
        else:
            problem = self._fault_since(instrument, reading.values, nominal, scatter)
            self._unsteady, self._rest = (reading.values, nominal), None
        if problem and self._doubted != visit:
            self._doubt(instrument, problem, visit)
            self._before = ()

    def less(
        self,
        instrument: Instrument,
        values: tuple[float, ...],
        nominal: tuple[float, ...],
        visit: int,
        time: float,
    ) -> list[float] | None:
        """What was read at a target less the zero, which is looked at first.

        Parameters
        ----------
        values
            Readings less `nominal`, mm or rad.
        nominal
            What a perfect machine would show there, but for the zero.
        visit
            Of the present set-up.
        time
            Of the rows that are made of it, s.

        Returns
        -------
        None where the reading cannot be this machine's: that is said, and it is not kept.
        """
        problem = ""
        if self._unsteady or self._rest:
            problem = self._fault_since(instrument, values, nominal)
        problem = problem or self._problem(instrument, values, nominal, visit)
        self._before, self._nominal, self._unsteady, self._rest = values, nominal, None, None
        if problem:
            self._doubt(instrument, problem, visit)
            return None
        self._first = self.renew or not self._zero
        if self._first:
            self._begin_part(instrument, values)
        here = self._course.here
        self._repeated.add(int(here.order[visit]), int(here.sense[visit]), values, time)
        if instrument.section.reads == "error":
            self._look_at_errors(
                instrument, values, instrument.sd(self._course.setup, int(here.order[visit]))
            )
        return [v - z for v, z in zip(values, self._zero, strict=True)]

    def _look_at_errors(self, instrument: Instrument, values: tuple[float, ...], sd: float) -> None:
        """Say where an instrument of errors reads as none does that measures."""
        if self._tiny.add(values, sd):
            self._news.event(
                "note",
                f"{instrument.name} differs from target to target by far less than its own "
                f"uncertainty of {size_words(sd, angle=instrument.angle)}: is it read in its own "
                f"unit ({instrument.unit}, channel {instrument.channel})?",
            )
        if self._same.add(values):
            self._news.event(
                "note",
                f"{instrument.name} has read the very same at {self._same.count} targets in a row: "
                "does it still measure?",
            )

    def _doubt(self, instrument: Instrument, problem: str, visit: int) -> None:
        self._news.event("doubt", f"{instrument.name} {problem}; this target is not kept")
        self._zero, self._doubted = (), visit
        self._broken = self._broken or self._course.parts[self._course.current] > 0

    def _fault_since(
        self,
        instrument: Instrument,
        values: tuple[float, ...],
        nominal: tuple[float, ...],
        scatter: float = 0.0,
    ) -> str:
        """What is surely wrong by the way from the target before, one of the two unsteady."""
        counted = self._zero and not self._first
        if instrument.section.reads != "length" or counted or "zero" not in self._course.setup.free:
            return ""
        if self._rest is not None and (
            said := self._fault_of_way(instrument, values, nominal, self._rest, scatter, slow=True)
        ):
            return said
        before = self._unsteady
        if before is None and self._before and not self.renew:
            before = self._before, self._nominal
        return self._fault_of_way(instrument, values, nominal, before, scatter) if before else ""

    def _fault_of_way(
        self,
        instrument: Instrument,
        values: tuple[float, ...],
        nominal: tuple[float, ...],
        before: tuple[tuple[float, ...], tuple[float, ...]],
        scatter: float,
        *,
        slow: bool = False,
    ) -> str:
        way = [v - b for v, b in zip(values, before[0], strict=True)]
        if max(abs(w) for w in way) <= max(instrument.section.jump * 1e-3, _SURE * scatter):
            return ""
        moved = [n - b for n, b in zip(nominal, before[1], strict=True)]
        return known_fault(way, moved, instrument.unit, instrument.channel, slow=slow)

    def _problem(
        self,
        instrument: Instrument,
        values: tuple[float, ...],
        nominal: tuple[float, ...],
        visit: int,
    ) -> str:
        """Why a reading cannot be this machine's; else empty. Another zero is noticed here."""
        setup, section = self._course.setup, instrument.section
        if setup.kind == Kind.DISTANCE:
            return other_unit(values, nominal)
        if self.renew or not self._before or "zero" not in setup.free:
            return ""
        unit = 1e-6 if instrument.angle else 1e-3
        way = [v - b for v, b in zip(values, self._before, strict=True)]
        if max(abs(w) for w in way) > section.jump * unit:
            if self._first or not self._zero:
                # the one before has begun to count there; two resets in a row are none
                if section.reads == "error":
                    return _no_error(way, instrument)
                moved = [n - b for n, b in zip(nominal, self._nominal, strict=True)]
                return not_followed(way, moved, instrument.unit, instrument.channel)
            by = "reset" if section.loses_zero else "touched"
            self._another(instrument, f"has jumped by {_most(way, instrument)}: it was {by}")
            return ""
        here = self._course.here
        at = int(here.order[visit]), int(here.sense[visit])
        slip = self._repeated.change(*at, values)
        if slip > section.slip * unit:
            self._slipped(instrument, slip, self._repeated.perhaps_lost(*at, values))
        return ""

    def _slipped(self, instrument: Instrument, slip: float, since: list[float]) -> None:
        course = self._course
        words = size_words(slip, angle=instrument.angle)
        self._another(instrument, f"has slipped by {words}, as targets read before tell")
        if since:
            name = part_name(course.setup.name, course.parts[course.current])
            self.perhaps_lost[name] = since
            self._news.event(
                "note",
                f"{instrument.name} may have lost these counts already on the way there: the rows "
                f"of {name} since then count from a zero of their own, too",
            )

    def _another(self, instrument: Instrument, why: str) -> None:
        self.renew = True
        words = f"{instrument.name} {why}; what follows is a set-up of its own"
        self._news.event("new zero", words)

    def _begin_part(self, instrument: Instrument, values: tuple[float, ...]) -> None:
        course, section = self._course, instrument.section
        if self.renew or self._broken or section.loses_zero or not course.parts[course.current]:
            course.parts[course.current] += 1
        self.renew = self._broken = False
        self._repeated.forget()
        self._tiny.forget()
        self._zero = values if section.reads == "length" else (0.0,) * len(values)


def _no_error(way: Sequence[float], instrument: Instrument) -> str:
    """That a reading changes from target to target as no machine's error does, and what to do."""
    return (
        f"has changed by {_most(way, instrument)} from one target to the next: is it read in its "
        f"own unit ({instrument.unit}, channel {instrument.channel}), and does its stand hold? "
        "Where the machine errs so much, raise jump in its section"
    )


def _most(way: Sequence[float], instrument: Instrument) -> str:
    return size_words(max(abs(w) for w in way), angle=instrument.angle)
