"""A measurement in which the machine touches a ball plate by itself, set-up after set-up."""

from __future__ import annotations

import asyncio
import contextlib
import time

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.calibrated_plate import CalibratedPlate
from abbe.compcore.artefacts.sphere import FittedSphere
from abbe.compcore.errors import AbbeError
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.probing.touches import farthest_three
from abbe.daemon.config.sections.probing import ProbingSection
from abbe.daemon.measure.course import MeasureCourse
from abbe.daemon.measure.events import Tell, setup_words
from abbe.daemon.measure.kept_rows import KeptRows
from abbe.daemon.measure.machine_view import SeenMachine
from abbe.daemon.measure.news import MeasureNews
from abbe.daemon.measure.person import LEAVE_OUT, Person
from abbe.daemon.measure.probing.guarded_tip import GuardedTip
from abbe.daemon.measure.probing.lying_plate import LyingPlate
from abbe.daemon.measure.probing.surroundings import Surroundings
from abbe.daemon.measure.probing.touched_sphere import MissedSphereError, SphereToucher
from abbe.daemon.measure.rows import part_name, read_back, rows_of, written
from abbe.daemon.measure.task import MeasureTask
from abbe.drivers.link import LinkError
from abbe.drivers.touch_probe import TouchProbe, touch_probe_of

F64 = NDArray[np.float64]


class _LeftOutError(Exception):
    """A person does without the set-up."""


class ProbedMeasurement:
    """One measurement by the machine's own probe.

    Parameters
    ----------
    task
        What is measured.
    course
        How far it is; its set-ups are placings of the plate.
    person
        Who places it.
    tell
        Is told what happens.

    Attributes
    ----------
    course
        As given; follows what is done.
    reason
        Why it ended before its last ball; empty when it did not.
    """

    def __init__(
        self, task: MeasureTask, course: MeasureCourse, person: Person, tell: Tell
    ) -> None:
        configuration = task.configuration
        section, plate = configuration.file.probing, task.plate
        assert section is not None and plate is not None  # noqa: S101, PT018 - else it is followed
        self._task = task
        self._section: ProbingSection = section
        self._plate: CalibratedPlate = plate
        self.course = course
        self.reason = ""
        self._person = person
        self._probe: TouchProbe | None = None
        self._rows = KeptRows(task.file)
        held = configuration.file.measure.signals_held
        self._news = MeasureNews(course, tell, task.file.path, task.expected, held)
        self._eyes = Surroundings(configuration, self._news, self._rows, stated=task.stated)
        self._clock = time.time() - time.monotonic() - task.started.timestamp()
        self._planned = [LyingPlate.planned(plate, setup) for setup in course.setups]

    @property
    def waiting(self) -> int:
        """Balls that were measured and whose rows are not on the disk."""
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
        index = self.course.current
        planned = self._planned[index]
        probe = self._probe = touch_probe_of(self._eyes.link(self._section.link))
        assert probe is not None  # noqa: S101 - the configuration was checked
        tip = GuardedTip(
            probe, self._task.configuration.model.machine, self._task.space, setup.offset
        )
        toucher = SphereToucher(tip, self._section, self._plate.diameter)
        for centre in planned.at(None):
            for place in toucher.places(centre, planned.normal):
                tip.look(place, place)
        await self._placed(setup)
        await self._eyes.look_at_tip(tip)
        lies = await self._align(tip, toucher, planned)
        # a frame of its own: nobody knows what became of the plate since its last rows
        self.course.parts[index] += 1
        self._news.next()
        visits = self.course.here
        first = True
        for visit in list(visits.left):
            visits.expected = visit
            ball = int(visits.order[visit])
            if first:
                seen = await self._eyes.complete()
                await tip.come(toucher.over(lies.at(self._warm(seen))[ball], lies.normal))
                first = False
            await self._ball(toucher, lies, setup, visit)
        await tip.draw_back()
        if not visits.left:
            self._news.setup_done(setup)

    async def _placed(self, setup: PlannedSetup) -> None:
        """Wait until a person says that the plate lies."""
        person = self._person
        person.forget()
        self.course.paused()
        press = "; Enter when it lies there and the way is free, s to leave it out"
        again = "again " if self.course.here.begun else ""
        self._news.event(
            "set up", f"set up {again}{setup_words(setup)}{press if person.there else ''}",
            missing=len(self.course.here.left),
        )  # fmt: skip
        while person.there:
            answer = person.answer()
            if answer == LEAVE_OUT:
                raise _LeftOutError
            if answer:
                return
            await self._eyes.look()

    async def _align(
        self, tip: GuardedTip, toucher: SphereToucher, planned: LyingPlate
    ) -> LyingPlate:
        numbers = farthest_three(self._plate.calibrated)
        warm = self._warm(await self._eyes.complete())
        spheres: list[FittedSphere] = []
        for number in numbers:
            centre = planned.at(warm)[number]
            over = toucher.over(centre, planned.normal)
            await (tip.go(over) if spheres else tip.come(over))
            try:
                spheres.append(await toucher.find(centre, planned.normal))
            except MissedSphereError as error:
                name = self._plate.points[number]
                raise AbbeError(f"ball {name} is not where the plan has it: {error}") from None
            await tip.go(over)
        own = self._section
        lies = planned.found(numbers, spheres, warm, off=own.off, placing=own.placing)
        assert lies.radius is not None  # noqa: S101
        if abs(lies.radius - toucher.reach) > own.off:
            raise AbbeError(
                f"the balls' radius with the tip's is {lies.radius:.3f} mm, and {toucher.reach:.3f}"
                " mm by [probing] tip and the plate's diameter"
            )
        names = ", ".join(self._plate.points[i] for i in numbers)
        self._news.event("aligned", f"balls {names} show where the plate lies")
        return lies

    # a ball

    async def _ball(
        self, toucher: SphereToucher, lies: LyingPlate, setup: PlannedSetup, visit: int
    ) -> None:
        ball = int(self.course.here.order[visit])
        name = self._plate.points[ball]
        coarse = ""
        for _ in range(2):
            seen = await self._eyes.complete()
            centre = lies.at(self._warm(seen))[ball]
            try:
                sphere = await toucher.measure(centre, lies.normal, lies.radius)
            except MissedSphereError as error:
                words = f"ball {name} of {setup.name}: {error}"
                if self._section.missed == "stop":
                    raise AbbeError(words) from None
                await toucher.leave(centre, lies.normal, error)
                self._news.event("missed", f"{words}; left out", visit=visit + 1)
                return
            then = await self._eyes.look()
            if self._eyes.missing(then):
                continue  # what was missing meanwhile is waited for, and the ball is touched again
            form = sphere.form * 1e3
            if form <= self._section.max_form:
                self._take(setup, visit, lies, sphere, then)
                return
            coarse = f"form deviation {form:.1f} µm"
            self._news.event("unsteady", f"ball {name}: {coarse}; touched again", visit=visit + 1)
        self._news.event(
            "missed", f"ball {name} of {setup.name}: {coarse or 'signals missing'}; left out",
            visit=visit + 1,
        )  # fmt: skip

    def _warm(self, seen: SeenMachine) -> float | None:
        name = self._section.plate_temperature
        return None if name is None else float(seen.signals[name].value)

    def _take(
        self,
        setup: PlannedSetup,
        visit: int,
        lies: LyingPlate,
        sphere: FittedSphere,
        seen: SeenMachine,
    ) -> None:
        course = self.course
        ball = int(course.here.order[visit])
        place = dict(seen.positions)
        for k, a in enumerate("XYZ"):
            place[a] = float(sphere.centre[k] - setup.offset[k])
        place = {a: read_back(a, str(written(a, q))) for a, q in place.items()}
        error = lies.at(self._warm(seen))[ball] - sphere.centre
        directions = setup.u[ball]
        stated = float(setup.sd[ball])
        part = course.parts[course.current]
        rows = rows_of(
            setup, part, ball, place, [float(error @ u) for u in directions],
            dict.fromkeys(place, 0.0), self._clock + seen.time,
            [float(np.hypot(stated, sphere.sd(u))) for u in directions],
            {name: seen.signals[name].value for name in self._eyes.signal_names},
        )  # fmt: skip
        for k, row in enumerate(rows):
            row["form"] = round(sphere.form * 1e3, 3)
            if self._plate.sd:
                row |= {"gauge": self._plate.gauge(ball, k), "gauge_sd": self._plate.sd * 1e3}
        course.here.take(visit)
        course.took(seen.time)

        def on_disk() -> None:
            self._news.row(setup, visit, part, rows, repeated=False)

        self._rows.add(rows, part_name(setup.name, part), setup.free, on_disk, seen.time)
        self._news.disk(self._rows.problem)
        if course.here.left:
            self._news.next()
