"""A measurement: a plan's set-ups followed on a machine, an instrument read, rows kept."""

from __future__ import annotations

import asyncio
import math
import time

from abbe.compcore.campaign.campaign import Kind
from abbe.daemon.measure.compensation import RunsBeside
from abbe.daemon.measure.course import MeasureCourse
from abbe.daemon.measure.events import Tell, place_words, setup_words, target_words
from abbe.daemon.measure.following.approach import Approach
from abbe.daemon.measure.following.average import SteadyReading
from abbe.daemon.measure.following.instrument import Instrument, nominal_distance
from abbe.daemon.measure.following.target_watch import (
    Outcome,
    StandsElsewhere,
    TargetLeft,
    TargetRead,
    TargetUnsteady,
    TargetWatch,
)
from abbe.daemon.measure.following.zero import InstrumentZero
from abbe.daemon.measure.kept_rows import KeptRows
from abbe.daemon.measure.machine_view import MachineView, SeenMachine
from abbe.daemon.measure.news import MeasureNews
from abbe.daemon.measure.person import LEAVE_OUT, Person
from abbe.daemon.measure.rows import part_name, read_back, rows_of, written
from abbe.daemon.measure.task import MeasureTask


class Measurement:
    """One measurement, from its first look to its last row.

    Parameters
    ----------
    task
        What is measured.
    course
        How far it is.
    person
        Who sets the instruments up.
    tell
        Is told what happens.

    Attributes
    ----------
    course
        As given; follows what is done.
    reason
        Why it ended too soon: of a machine that is followed, never.
    """

    reason = ""

    def __init__(
        self, task: MeasureTask, course: MeasureCourse, person: Person, tell: Tell
    ) -> None:
        self._task = task
        self.course = course
        self._person = person
        configuration = task.configuration
        self._limits = configuration.file.measure
        self._view = MachineView(configuration, task.instruments)
        self._watch = TargetWatch(self._limits, self._view.axes)
        self._approach = Approach(self._limits, self._view.axes)
        self._rows = KeptRows(task.file)
        held = self._limits.signals_held
        self._news = MeasureNews(course, tell, task.file.path, task.expected, held)
        self._clock = time.time() - time.monotonic() - task.started.timestamp()
        self._zero = InstrumentZero(course, self._news)
        # rows are there whose zero nobody knows any more
        self._zero.renew = course.here.begun and self._instrument.section.loses_zero
        self._anew = self._zero.renew and course.begin_anew()
        self._interruptions = 0
        self._ready = False
        self._lost = ""
        self._runs = RunsBeside(configuration)
        self._paused_by = ""
        self._over = False

    @property
    def _instrument(self) -> Instrument:
        return self._task.instruments[self.course.setup.instrument.key]

    async def run(self, stop: asyncio.Event) -> None:
        """Measure until nothing is left, or `stop` is set."""
        await self._view.open()
        self._person.begin()
        runs = asyncio.create_task(self._runs.watch())
        period = max(0.005, self._task.configuration.file.cycle.period)
        try:
            self._ask_for_setup()
            while not stop.is_set() and not self._at_end():
                due = time.monotonic() + period
                self._step(await self._view.look())
                await asyncio.sleep(max(0.0, due - time.monotonic()))
            await self._rows.last()
        finally:
            runs.cancel()
            await asyncio.gather(runs, return_exceptions=True)
            self._person.end()
            await self._view.close()

    @property
    def waiting(self) -> int:
        """Targets that were read and whose rows are not on the disk."""
        return self._rows.waiting

    @property
    def problem(self) -> str:
        """Why they are not."""
        return self._rows.problem

    def _at_end(self) -> bool:
        if self._rows.waiting:
            return False
        if self._over or self.course.next_setup() is None:
            return True
        last = self.course.current == len(self.course.setups) - 1
        return self._task.once and last and self.course.here.expected >= self.course.here.count

    # one look

    def _step(self, seen: SeenMachine) -> None:
        self._rows.flush(seen.time)
        self._news.disk(self._rows.problem)
        self._news.fault(seen)
        self._news.signals(seen)
        if self._paused():
            return
        self._follow_instrument()
        if not self._ready:
            self._wait_for_setup()
            return
        if self._task.once or not self._person.there:
            self._look_for_next_setup(seen)
        elif self._person.answer() == LEAVE_OUT:
            self._leave_out()
            return
        outcome = self._watch.step(seen, self._instrument, self.course.here)
        rest = self._approach.step(
            seen, self._instrument, self.course.setup, at_target=self._watch.at is not None
        )
        if rest is not None:
            self._zero.rested(*rest)
        self._judge(outcome, seen)

    def _paused(self) -> bool:
        if self._runs.live and not self._task.stated:
            if not self._paused_by:
                self._paused_by = self._runs.live
                self._news.event(
                    "paused",
                    f"{self._runs.live}, and [measure] active does not say what that does: "
                    "nothing is read until it has ended",
                )
            return True
        if self._paused_by:
            self._paused_by = ""
            self._news.event("back", "no correction runs any more: going on")
        return False

    def _follow_instrument(self) -> None:
        """Notice that the instrument was interrupted, and that it reads again."""
        instrument = self._instrument
        if instrument.interruptions != self._interruptions:
            self._interruptions = instrument.interruptions
            begun = self._ready and self.course.here.begun
            self._zero.interrupted(counts=begun and instrument.section.loses_zero)
            if begun and not self._lost:
                self._lost = instrument.problem or "it was away for a moment"
                self._news.event("lost", f"{instrument.name}: {self._lost}")
        if self._lost and not instrument.problem:
            self._lost = ""
            more = ""
            if self._zero.renew:
                more = ": its zero is another one now; what follows is a set-up of its own"
            self._news.event("back", f"{instrument.name} reads again{more}")

    # set-ups

    def _ask_for_setup(self) -> None:
        course = self.course
        self._ready = not self._person.there
        self._watch.forget()
        self._person.forget()
        self._interruptions = self._instrument.interruptions
        self._lost = ""
        course.paused()
        again = course.here.begun or self._anew
        words = "set up again" if again else "set up"
        press = "; Enter when it stands, s to leave it out" if self._person.there else ""
        self._news.event(
            "set up",
            f"{words} {setup_words(course.setup)}{press}",
            setup=course.setup.name,
            missing=len(course.here.left) if again else 0,
        )
        if again and self._instrument.section.loses_zero:
            self._zero.renew = True
            self._anew = course.begin_anew() or self._anew
        if self._ready:
            self._news.next()

    def _wait_for_setup(self) -> None:
        answer = self._person.answer()
        if answer == LEAVE_OUT:
            self._leave_out()
        elif answer or not self._person.there:
            self._ready = True
            self._interruptions = self._instrument.interruptions
            self._news.next()

    def _leave_out(self) -> None:
        name = self.course.setup.name
        self.course.leave_out()
        self._news.event("missed", f"{name} is left out", setup=name)
        self._go_on()

    def _go_on(self) -> None:
        """Turn to the set-up that comes next, if one does."""
        following = self.course.next_setup()
        if following is None or following == self.course.current:
            return
        if self._task.once and following < self.course.current:
            self._over = True
            return
        self.course.current = following
        self._zero.forget()
        self._anew = False
        self._ask_for_setup()

    def _look_for_next_setup(self, seen: SeenMachine) -> None:
        """With nobody to ask: a machine at the next set-up's first target has turned to it."""
        course = self.course
        if course.here.expected < course.here.count or not course.here.left or seen.fault:
            return
        following = course.next_setup()
        if following is None or following <= course.current:
            return
        there = course.visits[following].at(seen.positions, seen.directions)
        if there != 0 or course.here.at(seen.positions, seen.directions) in course.here.left:
            return
        self._go_on()

    # targets

    def _judge(self, outcome: Outcome, seen: SeenMachine) -> None:
        visits = self.course.here
        if isinstance(outcome, TargetRead):
            self._take(outcome, seen)
        elif isinstance(outcome, TargetUnsteady):
            self._news.unsteady(outcome)
            if outcome.reading is not None:
                self._look(outcome.visit, outcome.reading)
        elif isinstance(outcome, TargetLeft):
            if not visits.taken(outcome.visit):
                words = target_words(visits, outcome.visit)
                self._news.event("missed", f"left before it was read ({outcome.why}): {words}",
                            visit=outcome.visit + 1)  # fmt: skip
        elif isinstance(outcome, StandsElsewhere):
            away = visits.distance(seen.positions)
            self._news.event("next", f"stands {away:.3f} mm from the next target, "
                        + self._news.next_words())  # fmt: skip

    def _waits_for_first(self, visit: int) -> bool:
        """Whether a set-up that counts in one go only has another zero, not at its beginning."""
        self._anew = self._anew and visit != 0
        if self._anew:
            self._zero.renew = True
            name = self.course.setup.name
            words = f"{name} counts in one go only, and its zero is another one now: it is measured"
            self._news.event("next", f"{words} anew, from {self._news.next_words()}")
        return self._anew

    def _look(self, visit: int, reading: SteadyReading) -> None:
        """Take in readings that do not count: they may tell what is wrong."""
        place = dict(zip(self._view.axes, reading.positions, strict=True))
        nominal = self._instrument.nominal(self.course.setup, place)
        self._zero.look(self._instrument, reading, nominal, visit)

    def _take(self, read: TargetRead, seen: SeenMachine) -> None:
        course, setup, instrument = self.course, self.course.setup, self._instrument
        axes = self._view.axes
        place = dict(zip(axes, read.reading.positions, strict=True))
        # as the file will say it, so that who reads the file comes to the same visit
        place = {a: read_back(a, str(written(a, q))) for a, q in place.items()}
        visit = course.here.at(place, seen.directions)
        if visit is None:
            self._news.event("missed", f"stands at the edge of what counts as a target: "
                        f"{place_words(place)}")  # fmt: skip
            return
        target = int(course.here.order[visit])
        stated = float(setup.sd[target])
        if instrument.section.sd is not None:
            stated = instrument.section.sd * (1e-6 if instrument.angle else 1e-3)
        nominal = instrument.nominal(setup, place)
        time = self._clock + seen.time
        part = course.parts[course.current]
        values = self._zero.less(instrument, read.reading.values, nominal, visit, round(time, 3))
        if values is None:
            return
        if course.parts[course.current] > max(part, 1):
            if course.begin_anew():
                self._anew = True
                visit = course.here.at(place, seen.directions) or 0
            if self._waits_for_first(visit):
                course.parts[course.current] = part
                return
        sds = read.reading.sds(stated)
        if not instrument.section.linked:  # its file says, afterwards
            values = [math.nan] * setup.u.shape[1]
            sds = [stated] * len(values)
        if setup.kind == Kind.DISTANCE:
            values = [v + nominal_distance(setup, place) for v in values]
        repeated = course.here.taken(visit)
        left_out = course.here.take(visit)
        for i in left_out:
            self._news.event("missed", f"left out: {target_words(course.here, i)}", visit=i + 1)
        part = course.parts[course.current]
        rows = rows_of(
            setup, part, target, place, values,
            {a: seen.directions[a] for a in axes}, time,
            sds,
            {name: seen.signals[name].value for name in self._view.signal_names},
        )  # fmt: skip
        course.took(seen.time)

        def on_disk() -> None:
            self._news.row(setup, visit, part, rows, repeated=repeated)

        lost, self._zero.perhaps_lost = self._zero.perhaps_lost, {}
        name = part_name(setup.name, part)
        self._rows.add(rows, name, setup.free, on_disk, seen.time, perhaps_lost=lost)
        self._news.disk(self._rows.problem)
        if course.here.left:
            self._news.next()
        else:
            self._news.setup_done(setup)
            self._go_on()
