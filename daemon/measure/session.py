"""A measurement: a plan's set-ups followed on a machine, an instrument read, rows kept."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.files.growing_campaign import GrowingCampaign
from abbe.daemon.config import Configuration
from abbe.daemon.measure.compensation import live_correction
from abbe.daemon.measure.course import MeasureCourse
from abbe.daemon.measure.events import Tell, place_words, setup_words, target_words
from abbe.daemon.measure.instrument import Instrument, nominal_distance
from abbe.daemon.measure.kept_rows import KeptRows
from abbe.daemon.measure.machine_view import MachineView, SeenMachine
from abbe.daemon.measure.news import MeasureNews
from abbe.daemon.measure.person import LEAVE_OUT, Person
from abbe.daemon.measure.rows import part_name, read_back, rows_of, written
from abbe.daemon.measure.target_watch import (
    Outcome,
    StandsElsewhere,
    TargetLeft,
    TargetRead,
    TargetUnsteady,
    TargetWatch,
)

_LAST_TRIES = 5.0
"""s for which, at the end, rows that are not on the disk are tried to be written."""
_LOOK_FOR_RUNS = 10.0
"""s between two looks at whether a correction runs."""


@dataclass(frozen=True)
class MeasureTask:
    """What is to be measured, and where it goes.

    Attributes
    ----------
    configuration
        Machine, links, instruments.
    file
        The campaign, begun or gone on with.
    started
        Its start, UTC.
    instruments
        Plan's instrument → the one that stands for it.
    expected
        Set-up → uncertainty over the volume before and after it, mm.
    stated
        Whether it is stated which compensation acts.
    once
        Whether what was missed is not waited for.
    """

    configuration: Configuration
    file: GrowingCampaign
    started: datetime
    instruments: Mapping[str, Instrument]
    expected: Mapping[str, tuple[float, float]]
    stated: bool
    once: bool = False


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
    """

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
        self._rows = KeptRows(task.file)
        held = self._limits.signals_held
        self._news = MeasureNews(course, tell, task.file.path, task.expected, held)
        self._clock = time.time() - time.monotonic() - task.started.timestamp()
        self._zero: tuple[float, ...] = ()
        self._before: tuple[float, ...] = ()
        # rows are there whose zero nobody knows any more
        self._renew = course.here.begun and self._instrument.section.loses_zero
        self._interruptions = 0
        self._ready = False
        self._lost = ""
        self._live = ""
        self._paused_by = ""
        self._over = False

    @property
    def _instrument(self) -> Instrument:
        return self._task.instruments[self.course.setup.instrument.key]

    async def run(self, stop: asyncio.Event) -> None:
        """Measure until nothing is left, or `stop` is set."""
        await self._view.open()
        self._person.begin()
        runs = asyncio.create_task(self._look_for_runs())
        period = max(0.005, self._task.configuration.file.cycle.period)
        try:
            self._ask_for_setup()
            while not stop.is_set() and not self._at_end():
                due = time.monotonic() + period
                self._step(await self._view.look())
                await asyncio.sleep(max(0.0, due - time.monotonic()))
            await self._last_rows()
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

    async def _last_rows(self) -> None:
        until = time.monotonic() + _LAST_TRIES
        while self._rows.waiting and time.monotonic() < until:
            self._rows.flush(time.monotonic(), at_once=True)
            await asyncio.sleep(0.2)

    async def _look_for_runs(self) -> None:
        while True:
            await asyncio.sleep(_LOOK_FOR_RUNS)
            self._live = await asyncio.to_thread(live_correction, self._task.configuration)

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
        self._judge(self._watch.step(seen, self._instrument, self.course.here), seen)

    def _paused(self) -> bool:
        if self._live and not self._task.stated:
            if not self._paused_by:
                self._paused_by = self._live
                self._news.event(
                    "paused",
                    f"{self._live}, and [measure] active does not say what that does: nothing is "
                    "read until it has ended",
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
            if self._ready and self.course.here.begun:
                self._renew = self._renew or instrument.section.loses_zero
                if not self._lost:
                    self._lost = instrument.problem or "it was away for a moment"
                    self._news.event("lost", f"{instrument.name}: {self._lost}")
        if self._lost and not instrument.problem:
            self._lost = ""
            more = ""
            if self._renew:
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
        again = course.here.begun
        words = "set up again" if again else "set up"
        press = "; Enter when it stands, s to leave it out" if self._person.there else ""
        self._news.event(
            "set up",
            f"{words} {setup_words(course.setup)}{press}",
            setup=course.setup.name,
            missing=len(course.here.left) if again else 0,
        )
        if again:
            self._renew = self._renew or self._instrument.section.loses_zero
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
        self._zero = self._before = ()
        self._renew = False
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
        elif isinstance(outcome, TargetLeft):
            if not visits.taken(outcome.visit):
                words = target_words(visits, outcome.visit)
                self._news.event("missed", f"left before it was read ({outcome.why}): {words}",
                            visit=outcome.visit + 1)  # fmt: skip
        elif isinstance(outcome, StandsElsewhere):
            away = visits.distance(seen.positions)
            self._news.event("next", f"stands {away:.3f} mm from the next target, "
                        + self._news.next_words())  # fmt: skip

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
        self._look_for_new_zero(read.reading.values)
        self._before = read.reading.values
        if not self._zero:
            self._begin_part(read.reading.values)
        values = [v - z for v, z in zip(read.reading.values, self._zero, strict=True)]
        if setup.kind == Kind.DISTANCE:
            values = [v + nominal_distance(setup, place) for v in values]
        target = int(course.here.order[visit])
        stated = float(setup.sd[target])
        if instrument.section.sd is not None:
            stated = instrument.section.sd * (1e-6 if instrument.angle else 1e-3)
        repeated = course.here.taken(visit)
        left_out = course.here.take(visit)
        for i in left_out:
            self._news.event("missed", f"left out: {target_words(course.here, i)}", visit=i + 1)
        part = course.parts[course.current]
        rows = rows_of(
            setup, part, target, read.reading, place, values,
            {a: seen.directions[a] for a in axes}, self._clock + seen.time, stated,
            {name: seen.signals[name].value for name in self._view.signal_names},
        )  # fmt: skip
        course.took(seen.time)

        def on_disk() -> None:
            self._news.row(setup, visit, part, rows, repeated=repeated)

        self._rows.add(rows, part_name(setup.name, part), setup.free, on_disk, seen.time)
        self._news.disk(self._rows.problem)
        if course.here.left:
            self._news.next()
        else:
            self._news.setup_done(setup)
            self._go_on()

    def _look_for_new_zero(self, values: tuple[float, ...]) -> None:
        """A reading that has jumped counts from another zero, whoever reset it."""
        instrument = self._instrument
        if self._zero and self._before and instrument.section.loses_zero and not self._renew:
            scale = 1e6 if instrument.angle else 1e3
            way = max(abs(v - b) for v, b in zip(values, self._before, strict=True)) * scale
            if way > instrument.section.jump:
                unit = "µrad" if instrument.angle else "µm"
                self._renew = True
                self._news.event(
                    "new zero",
                    f"{instrument.name} has jumped by {way:.0f} {unit}: it was reset; what follows "
                    "is a set-up of its own",
                )
        if self._renew:
            self._renew = False
            self._zero = ()

    def _begin_part(self, values: tuple[float, ...]) -> None:
        course = self.course
        counts = self._instrument.section.reads == "length"
        goes_on = course.parts[course.current] and not self._instrument.section.loses_zero
        if not goes_on:
            course.parts[course.current] += 1
        self._zero = tuple(values) if counts else (0.0,) * len(values)
