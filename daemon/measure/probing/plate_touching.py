"""A ball plate touched: three of its balls show where it lies, then ball after ball."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from abbe.compcore.artefacts.calibrated_plate import CalibratedPlate
from abbe.compcore.artefacts.sphere import FittedSphere
from abbe.compcore.errors import AbbeError
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.probing.touches import farthest_three
from abbe.daemon.measure.machine_view import SeenMachine
from abbe.daemon.measure.probing.artefact import TouchedArtefact, TouchingWork
from abbe.daemon.measure.probing.guarded_tip import GuardedTip
from abbe.daemon.measure.probing.lying_plate import LyingPlate
from abbe.daemon.measure.probing.one_sphere import one_sphere
from abbe.daemon.measure.probing.touched_sphere import MissedSphereError, SphereToucher


class PlateTouching(TouchedArtefact):
    """The plate of a measurement, in the placings of its plan.

    Parameters
    ----------
    work
        What is shared.
    plate
        The plate.
    setups
        Its placings.

    Raises
    ------
    InputError
        When they were not planned for this plate.
    """

    def __init__(
        self, work: TouchingWork, plate: CalibratedPlate, setups: Sequence[PlannedSetup]
    ) -> None:
        self._work = work
        self._plate = plate
        self._planned = {setup.name: LyingPlate.planned(plate, setup) for setup in setups}

    def look(self, tip: GuardedTip, setup: PlannedSetup) -> None:
        """As `TouchedArtefact.look`."""
        planned = self._planned[setup.name]
        toucher = self._toucher(tip)
        for centre in planned.at(None):
            for place in toucher.places(centre, planned.normal):
                tip.look(place, place)

    async def measure(self, tip: GuardedTip, setup: PlannedSetup) -> None:
        """As `TouchedArtefact.measure`."""
        work, course = self._work, self._work.course
        toucher = self._toucher(tip)
        lies = await self._align(tip, toucher, self._planned[setup.name])
        # a frame of its own: nobody knows what became of the plate since its last rows
        course.parts[course.current] += 1
        work.news.next()
        visits = course.here
        first = True
        for visit in list(visits.left):
            visits.expected = visit
            ball = int(visits.order[visit])
            if first:
                seen = await work.eyes.complete()
                await tip.come(toucher.over(lies.at(work.warm(seen))[ball], lies.normal))
                first = False
            await self._ball(toucher, lies, setup, visit)

    def _toucher(self, tip: GuardedTip) -> SphereToucher:
        return SphereToucher(tip, self._work.section, self._plate.diameter)

    async def _align(
        self, tip: GuardedTip, toucher: SphereToucher, planned: LyingPlate
    ) -> LyingPlate:
        work, own = self._work, self._work.section
        numbers = farthest_three(self._plate.calibrated)
        warm = work.warm(await work.eyes.complete())
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
        lies = planned.found(numbers, spheres, warm, off=own.off, placing=own.placing)
        assert lies.radius is not None  # noqa: S101
        toucher.require_radius(lies.radius, "the balls'")
        names = ", ".join(self._plate.points[i] for i in numbers)
        work.news.event("aligned", f"balls {names} show where the plate lies")
        return lies

    async def _ball(
        self, toucher: SphereToucher, lies: LyingPlate, setup: PlannedSetup, visit: int
    ) -> None:
        work = self._work
        ball = int(work.course.here.order[visit])
        name = f"ball {self._plate.points[ball]} of {setup.name}"
        found = await one_sphere(
            work, toucher, name, visit,
            lambda seen: (lies.at(work.warm(seen))[ball], lies.normal), lies.radius,
        )  # fmt: skip
        if found is not None:
            self._take(setup, visit, lies, *found)

    def _take(
        self,
        setup: PlannedSetup,
        visit: int,
        lies: LyingPlate,
        sphere: FittedSphere,
        seen: SeenMachine,
    ) -> None:
        work, plate = self._work, self._plate
        ball = int(work.course.here.order[visit])
        place = dict(seen.positions)
        for k, a in enumerate("XYZ"):
            place[a] = float(sphere.centre[k] - setup.offset[k])
        error = lies.at(work.warm(seen))[ball] - sphere.centre
        directions = setup.u[ball]
        stated = float(setup.sd[ball])
        form = round(sphere.form * 1e3, 3)
        more: list[dict[str, str | float]] = [{"form": form} for _ in directions]
        if plate.sd:
            for k, own in enumerate(more):
                own |= {"gauge": plate.gauge(ball, k), "gauge_sd": plate.sd * 1e3}
        work.take(
            setup, visit, place, [float(error @ u) for u in directions],
            [float(np.hypot(stated, sphere.sd(u))) for u in directions], seen, more=more,
        )  # fmt: skip
