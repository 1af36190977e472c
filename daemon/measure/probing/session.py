"""A measurement in which the machine touches an artefact by itself, set-up after set-up."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Sequence

from abbe.compcore.artefacts.calibrated_gauge import CalibratedGauge
from abbe.compcore.artefacts.calibrated_plate import CalibratedPlate
from abbe.compcore.errors import AbbeError
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.probing.standing_sphere import StandardSphere
from abbe.daemon.config.sections.probing import ProbingSection
from abbe.daemon.measure.course import MeasureCourse
from abbe.daemon.measure.events import Tell, setup_words
from abbe.daemon.measure.kept_rows import KeptRows
from abbe.daemon.measure.news import MeasureNews
from abbe.daemon.measure.person import LEAVE_OUT, Person
from abbe.daemon.measure.probing.artefact import TouchedArtefact, TouchingWork
from abbe.daemon.measure.probing.gauge_touching import GaugeTouching
from abbe.daemon.measure.probing.guarded_tip import GuardedTip
from abbe.daemon.measure.probing.plate_touching import PlateTouching
from abbe.daemon.measure.probing.sphere_touching import SphereTouching
from abbe.daemon.measure.probing.surroundings import Surroundings
from abbe.daemon.measure.task import MeasureTask
from abbe.drivers.link import LinkError
from abbe.drivers.touch_probe import TouchProbe, TouchTravel, touch_probe_of


class _LeftOutError(Exception):
    """A person does without the set-up."""


class ProbedMeasurement:
    """One measurement by the machine's own probe.

    Parameters
    ----------
    task
        What is measured.
    course
        How far it is; its set-ups are placings of the artefact.
    person
        Who places it.
    tell
        Is told what happens.

    Raises
    ------
    InputError
        When the artefact does not fit the plan, or some place of it is not free.

    Attributes
    ----------
    course
        As given; follows what is done.
    reason
        Why it ended before its last visit; empty when it did not.
    """

    def __init__(
        self, task: MeasureTask, course: MeasureCourse, person: Person, tell: Tell
    ) -> None:
        configuration = task.configuration
        section = configuration.file.probing
        assert section is not None and task.touched is not None  # noqa: S101, PT018 - else it is followed
        self._task = task
        self._section: ProbingSection = section
        self.course = course
        self.reason = ""
        self._person = person
        self._probe: TouchProbe | None = None
        self._rows = KeptRows(task.file)
        held = configuration.file.measure.signals_held
        self._news = MeasureNews(course, tell, task.file.path, task.expected, held)
        self._eyes = Surroundings(configuration, self._news, self._rows, stated=task.stated)
        work = TouchingWork(
            section, configuration.model.machine, task.space, course, self._news, self._eyes,
            self._rows, time.time() - time.monotonic() - task.started.timestamp(),
        )  # fmt: skip
        self._artefact = _touching(work, task.touched, course.setups)
        for setup in course.setups:
            self._artefact.look(self._tip_of(setup), setup)

    @property
    def waiting(self) -> int:
        """Visits that were measured and whose rows are not on the disk."""
        return self._rows.waiting

    @property
    def problem(self) -> str:
        """Why they are not."""
        return self._rows.problem

    async def run(self, stop: asyncio.Event) -> None:
        """Measure until nothing is left, something stops it, or `stop` is set."""
        await self._eyes.open()
        self._person.begin()
        work = asyncio.create_task(self._all())
        stopped = asyncio.create_task(stop.wait())
        try:
            await asyncio.wait([work, stopped], return_when=asyncio.FIRST_COMPLETED)
            if not work.done():
                work.cancel()
                await self._halt()
            with contextlib.suppress(asyncio.CancelledError):
                await work
            await self._rows.last()
        finally:
            for task in (work, stopped):
                task.cancel()
            await asyncio.gather(work, stopped, return_exceptions=True)
            self._person.end()
            await self._eyes.close()

    async def _all(self) -> None:
        course = self.course
        try:
            while course.here.left or course.next_setup() is not None:
                if not course.here.left:
                    course.current = course.next_setup() or course.current
                try:
                    await self._setup(course.setup)
                except _LeftOutError:
                    self._news.event("missed", f"{course.setup.name} is left out")
                course.leave_out()
                following = course.next_setup()
                if following is None:
                    return
                course.current = following
        except (LinkError, AbbeError) as error:
            self.reason = str(error)
            if isinstance(error, LinkError):
                await self._halt()
            self._news.event("stopped", f"stopped: {error}; the machine is left where it is")

    async def _halt(self) -> None:
        if self._probe is not None:
            await self._probe.halt()

    # a set-up

    async def _setup(self, setup: PlannedSetup) -> None:
        tip = self._tip_of(setup)
        self._artefact.look(tip, setup)
        await self._placed(setup)
        await self._eyes.look_at_tip(tip)
        own = self._section
        # what is not touched yet is come to with the stated speed, too
        await tip.begin(
            TouchTravel(own.speed, own.touch_speed, 0.5 * own.tip, own.approach, own.search)
        )
        await self._artefact.measure(tip, setup)
        await tip.draw_back()
        if not self.course.here.left:
            self._news.setup_done(setup)

    def _tip_of(self, setup: PlannedSetup) -> GuardedTip:
        probe = self._probe = touch_probe_of(self._eyes.link(self._section.link))
        assert probe is not None  # noqa: S101 - the configuration was checked
        machine = self._task.configuration.model.machine
        return GuardedTip(probe, machine, self._task.space, setup.offset, self._task.turns)

    async def _placed(self, setup: PlannedSetup) -> None:
        """Wait until a person says that the artefact lies or stands."""
        person = self._person
        person.forget()
        self.course.paused()
        press = "; Enter when it is there and the way is free, s to leave it out"
        again = "again " if self.course.here.begun else ""
        self._news.event(
            "set up", f"set up {again}{setup_words(setup)}{press if person.there else ''}",
            setup=setup.name, missing=len(self.course.here.left),
        )  # fmt: skip
        while person.there:
            answer = person.answer()
            if answer == LEAVE_OUT:
                raise _LeftOutError
            if answer:
                return
            await self._eyes.look()


def _touching(
    work: TouchingWork,
    touched: CalibratedPlate | CalibratedGauge | StandardSphere,
    setups: Sequence[PlannedSetup],
) -> TouchedArtefact:
    if isinstance(touched, StandardSphere):
        return SphereTouching(work, touched, setups)
    if isinstance(touched, CalibratedGauge):
        return GaugeTouching(work, touched, setups)
    return PlateTouching(work, touched, setups)
