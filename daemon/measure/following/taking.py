"""What was read at a target becomes rows of the campaign, or is said not to be this machine's."""

from __future__ import annotations

import math
from collections.abc import Mapping

from abbe.compcore.campaign.campaign import Kind
from abbe.daemon.measure.course import MeasureCourse
from abbe.daemon.measure.events import place_words, target_words
from abbe.daemon.measure.following.arrival_feed import ArrivalFeed
from abbe.daemon.measure.following.average import SteadyReading
from abbe.daemon.measure.following.instrument import Instrument
from abbe.daemon.measure.following.nudge import NudgeCheck
from abbe.daemon.measure.following.target_watch import TargetRead
from abbe.daemon.measure.following.zero import InstrumentZero
from abbe.daemon.measure.kept_rows import KeptRows
from abbe.daemon.measure.machine_view import MachineView, SeenMachine
from abbe.daemon.measure.news import MeasureNews
from abbe.daemon.measure.rows import part_name, read_back, rows_of, written


class TargetTaking:
    """Takes in what was read at the targets of the present set-up.

    Parameters
    ----------
    course
        How far the measurement is; what is taken is noted there.
    view
        The machine's axes and signals.
    feed
        How fast the machine came.
    zero
        From which the instrument counts.
    nudge
        What the instrument shows of a small known move.
    rows
        Where rows go.
    news
        Is told what happens.
    clock
        Start of the campaign's time, s, on the monotonic clock, with its sign reversed.
    anew
        Whether the present set-up, which counts in one go only, waits for its first target.

    Attributes
    ----------
    anew
        As given; follows what is read.
    """

    def __init__(
        self,
        course: MeasureCourse,
        view: MachineView,
        feed: ArrivalFeed,
        zero: InstrumentZero,
        nudge: NudgeCheck,
        rows: KeptRows,
        news: MeasureNews,
        clock: float,
        *,
        anew: bool,
    ) -> None:
        self._course = course
        self._view = view
        self._feed = feed
        self._zero = zero
        self._nudge = nudge
        self._rows = rows
        self._news = news
        self._clock = clock
        self.anew = anew
        self._last: int | None = None

    def forget(self) -> None:
        """Turn to another set-up."""
        self.anew, self._last = False, None
        self.restarted()

    def restarted(self) -> None:
        """Note that the instrument may have been switched off: what it showed counts no more."""
        self._nudge.forget()

    def interrupted(self) -> None:
        """Note that the instrument counts from another zero: half a nudge is none."""
        if not self._nudge.follows:
            self._nudge.forget()

    def unproven(self, instrument: Instrument) -> None:
        """Say that nothing shows whether an instrument is what it was, where nothing does.

        Without a nudge nobody but a person sees that its sign or unit is another one now.
        """
        setup = self._course.setup
        blind = instrument.section.reads == "error" and not self._nudge.wanted(setup)
        if not blind or not self._course.here.begun:
            return
        self._news.event(
            "note",
            f"{instrument.name} was left alone, and nothing here shows whether its sign and unit "
            "are what they were: look whether it reads the same at a target that was read before",
        )

    def nudging(self, visit: int) -> bool:
        """Whether a stand at a visit may be one of the nudge."""
        return self._nudge.awaited(self._course.setup, int(self._course.here.order[visit]))

    def look(self, visit: int, reading: SteadyReading, instrument: Instrument) -> None:
        """Take in readings that do not count: they may tell what is wrong."""
        place = dict(zip(self._view.axes, reading.positions, strict=True))
        nominal = instrument.nominal(self._course.setup, place)
        self._zero.look(instrument, reading, nominal, visit)

    def take(self, read: TargetRead, seen: SeenMachine, instrument: Instrument) -> bool:
        """Make rows of a target that was read; whether there are any."""
        course, setup = self._course, self._course.setup
        axes = self._view.axes
        place = dict(zip(axes, read.reading.positions, strict=True))
        # as the file will say it, so that who reads the file comes to the same visit
        place = {a: read_back(a, str(written(a, q))) for a, q in place.items()}
        visit = course.here.at(place, seen.directions)
        if visit is None:
            words = f"stands at the edge of what counts as a target: {place_words(place)}"
            self._news.event("missed", words)
            return False
        target = int(course.here.order[visit])
        found = self._nudged(instrument, place, read.reading.values, visit)
        if found is None:
            return False
        nominal = instrument.nominal(setup, place)
        time = self._clock + seen.time
        part = course.parts[course.current]
        values = self._zero.less(instrument, found, nominal, visit, round(time, 3))
        if values is None:
            return False
        if course.parts[course.current] > max(part, 1):
            if course.begin_anew():
                self.anew = True
                visit = course.here.at(place, seen.directions) or 0
            if self._waits_for_first(visit):
                course.parts[course.current] = part
                return False
        stated = instrument.sd(setup, target)
        sds = read.reading.sds(stated)
        if not instrument.section.linked:  # its file says, afterwards
            values = [math.nan] * setup.u.shape[1]
            sds = [stated] * len(values)
        if setup.kind == Kind.DISTANCE:
            values = [v + instrument.nominal_distance(setup, place) for v in values]
        repeated = course.here.taken(visit)
        self._last = None if repeated else visit
        for i in course.here.take(visit):
            self._news.event("missed", f"left out: {target_words(course.here, i)}", visit=i + 1)
        part = course.parts[course.current]
        rows = rows_of(
            setup, part, target, place, values,
            {a: seen.directions[a] for a in axes}, time,
            sds,
            {name: seen.signals[name].value for name in self._view.signal_names},
            self._feed.values(),
        )  # fmt: skip
        course.took(seen.time)

        def on_disk() -> None:
            self._news.row(setup, visit, part, rows, repeated=repeated)

        lost, self._zero.perhaps_lost = self._zero.perhaps_lost, {}
        name = part_name(setup.name, part)
        self._rows.add(rows, name, setup.free, on_disk, seen.time, perhaps_lost=lost)
        return True

    def withdraw(self, visit: int) -> bool:
        """Take back what was kept last where it was of this visit; whether it was."""
        if self._last != visit or not self._rows.withdraw():
            return False
        self._last = None
        self._course.here.give_back(visit)
        self._zero.withdraw()
        return True

    def _nudged(
        self,
        instrument: Instrument,
        place: Mapping[str, float],
        values: tuple[float, ...],
        visit: int,
    ) -> tuple[float, ...] | None:
        """What counts of a reading; None at the nudge, and while what it showed is in doubt."""
        nudge, course = self._nudge, self._course
        setup = course.setup
        if instrument.section.reads != "error" or not nudge.wanted(setup):
            return values
        target, begun = int(course.here.order[visit]), course.here.begun
        which = "this" if begun else "the first"
        if nudge.awaited(setup, target) and nudge.turning(setup, place):
            if nudge.take_end(setup, target, place, values):
                words = f"{instrument.name} was read where the machine stood aside of the line"
                self._news.event("note", f"{words}: back to {which} target")
            return None
        if follows := nudge.judge(setup, target, instrument, place, values):
            self._news.event("note", follows)
        doubt = ""
        if nudge.problem:
            doubt = nudge.problem_at(target)
        elif not nudge.follows:
            way = ", ".join(f"{a} {by:+.3f} mm" for a, by in nudge.wanted(setup).items())
            since = "since it was left alone" if begun else "yet"
            doubt = (
                f"was not seen to follow the machine {since}, with its sign, in its unit and in "
                f"time: go {way} aside of {which} target, stand there as long as at a target, and "
                "come back to it, as the program of this set-up does at its beginning"
            )
        if doubt:
            self._news.event("doubt", f"{instrument.name} {doubt}; this target is not kept")
            return None
        # it shows where the machine stands across the line, and that is indicated
        aside = nudge.aside(setup, place)
        return tuple(v - a for v, a in zip(values, aside, strict=True))

    def _waits_for_first(self, visit: int) -> bool:
        """Whether a set-up that counts in one go only has another zero, not at its beginning."""
        self.anew = self.anew and visit != 0
        if self.anew:
            self._zero.renew = True
            name = self._course.setup.name
            words = f"{name} counts in one go only, and its zero is another one now: it is measured"
            self._news.event("next", f"{words} anew, from {self._news.next_words()}")
        return self.anew
