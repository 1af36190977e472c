"""A measurement: a plan's set-ups followed on a machine, an instrument read, rows kept."""

from __future__ import annotations

import asyncio
import math
import time

from abbe.daemon.measure.compensation import RunsBeside
from abbe.daemon.measure.course import MeasureCourse
from abbe.daemon.measure.events import Tell, setup_words, target_words
from abbe.daemon.measure.following.approach import Approach
from abbe.daemon.measure.following.arrival_feed import ArrivalFeed
from abbe.daemon.measure.following.instrument import Instrument
from abbe.daemon.measure.following.nudge import NudgeCheck
from abbe.daemon.measure.following.taking import TargetTaking
from abbe.daemon.measure.following.target_watch import (
    Outcome,
    StandsElsewhere,
    TargetChanged,
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
        self._feed = ArrivalFeed(self._limits, self._view.axes)
        self._rows = KeptRows(task.file)
        held = self._limits.signals_held
        self._news = MeasureNews(course, tell, task.file.path, task.expected, held)
        self._zero = InstrumentZero(course, self._news)
        self._nudge = NudgeCheck(configuration.model.machine, task.space.nudge)
        # rows are there whose zero nobody knows any more
        self._zero.renew = course.here.begun and self._instrument.section.loses_zero
        clock = time.time() - time.monotonic() - task.started.timestamp()
        self._taking = TargetTaking(
            course, self._view, self._feed, self._zero, self._nudge, self._rows, self._news, clock,
            anew=self._zero.renew and course.begin_anew(),
        )  # fmt: skip
        self._interruptions = self._restarts = 0
        self._ready = False
        self._lost = ""
        self._runs = RunsBeside(configuration)
        self._paused_by = ""
        self._over = False
        self._reached = 0

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
        reached = max(self.course.here.expected, self._reached)
        return self._task.once and last and reached >= self.course.here.count

    # one look

    def _step(self, seen: SeenMachine) -> None:
        self._feed.look(seen)
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
        if rest is not None and not self._watch.not_come:
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
        if instrument.restarts != self._restarts:
            self._restarts = instrument.restarts
            self._taking.restarted()
            self._taking.unproven(instrument)
        if instrument.interruptions != self._interruptions:
            self._interruptions = instrument.interruptions
            if instrument.section.loses_zero:
                self._taking.interrupted()
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

    def _ask_for_setup(self, seen: SeenMachine | None = None) -> None:
        course = self.course
        self._ready = not self._person.there
        # with nobody to ask, what was set up before may stand for as long as the machine does
        self._watch.forget(seen if self._ready else None)
        self._person.forget()
        self._interruptions = self._instrument.interruptions
        self._lost = ""
        course.paused()
        again = course.here.begun or self._taking.anew
        words = "set up again" if again else "set up"
        press = "; Enter when it stands, s to leave it out" if self._person.there else ""
        self._news.event(
            "set up",
            f"{words} {setup_words(course.setup)}{press}",
            setup=course.setup.name,
            missing=len(course.here.left) if again else 0,
        )
        if again:
            self._taking.unproven(self._instrument)
        if again and self._instrument.section.loses_zero:
            self._zero.renew = True
            self._taking.anew = course.begin_anew() or self._taking.anew
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

    def _go_on(self, seen: SeenMachine | None = None) -> None:
        """Turn to the set-up that comes next, if one does; `seen`: as it stands in this one."""
        following = self.course.next_setup()
        if following is None or following == self.course.current:
            return
        if self._task.once and following < self.course.current:
            self._over = True
            return
        self.course.current = following
        self._zero.forget()
        self._taking.forget()
        self._reached = 0
        self._ask_for_setup(seen)

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
            self._reached = max(self._reached, outcome.visit + 1)
            if self._taking.take(outcome, seen, self._instrument):
                self._news.disk(self._rows.problem)
                if visits.left:
                    self._news.next()
                else:
                    self._news.setup_done(self.course.setup)
                    self._go_on(seen)
        elif isinstance(outcome, TargetUnsteady):
            self._news.unsteady(outcome)
            if outcome.reading is not None:
                self._taking.look(outcome.visit, outcome.reading, self._instrument)
        elif isinstance(outcome, TargetChanged):
            withdrawn = self._taking.withdraw(outcome.visit)
            self._news.changed(outcome, self._instrument, withdrawn=withdrawn)
        elif isinstance(outcome, TargetLeft):
            if not visits.taken(outcome.visit) and not self._taking.nudging(outcome.visit):
                words = target_words(visits, outcome.visit)
                self._news.event("missed", f"left before it was read ({outcome.why}): {words}",
                            visit=outcome.visit + 1)  # fmt: skip
        elif isinstance(outcome, StandsElsewhere):
            away = visits.distance(seen.positions)
            turn = math.degrees(visits.turn(seen.positions))
            more = f" and {turn:.3f}°" if turn else ""
            self._news.event("next", f"stands {away:.3f} mm{more} from the next target, "
                        + self._news.next_words())  # fmt: skip
