"""A sphere on the table touched at every angle of the plan, the tip drawn back while it turns."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, radians

import numpy as np

from abbe.compcore.errors import AbbeError
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.probing.standing_sphere import (
    StandardSphere,
    StandingSphere,
    turning_axes,
)
from abbe.compcore.planning.probing.touches import OVER_POST
from abbe.daemon.measure.machine_view import SeenMachine
from abbe.daemon.measure.probing.artefact import TouchedArtefact, TouchingWork
from abbe.daemon.measure.probing.guarded_tip import GuardedTip
from abbe.daemon.measure.probing.one_sphere import one_sphere
from abbe.daemon.measure.probing.touched_sphere import MissedSphereError, SphereToucher

_WITHIN = radians(0.05)
"""By which a rotary axis may stand beside its target, rad."""
_STANDS_STILL = radians(0.01)
"""By which a table may move while a sphere on it is touched, rad."""


class SphereTouching(TouchedArtefact):
    """The sphere of a measurement, in the places of its plan.

    Parameters
    ----------
    work
        What is shared.
    sphere
        The sphere.
    setups
        Where it stands.

    Raises
    ------
    InputError
        When they do not follow a sphere.
    """

    def __init__(
        self,
        work: TouchingWork,
        sphere: StandardSphere,
        setups: Sequence[PlannedSetup],
    ) -> None:
        self._work = work
        self._sphere = sphere
        shaft = work.section.shaft
        self._planned = {s.name: StandingSphere.planned(work.machine, s, shaft) for s in setups}

    def look(self, tip: GuardedTip, setup: PlannedSetup) -> None:
        """As `TouchedArtefact.look`."""
        planned = self._planned[setup.name]
        for k in range(setup.count):
            angles = {a: float(q[k]) for a, q in setup.targets.items() if is_rotary(a)}
            toucher = self._toucher(tip, planned, angles)
            for place in toucher.places(planned.at(angles), planned.normal(angles)):
                tip.look(place, place)

    async def measure(self, tip: GuardedTip, setup: PlannedSetup) -> None:
        """As `TouchedArtefact.measure`."""
        work, course = self._work, self._work.course
        visits = course.here
        stands: StandingSphere | None = None
        for visit in list(visits.left):
            visits.expected = visit
            angles = await self._turn(tip, setup, visit)
            toucher = self._toucher(tip, stands or self._planned[setup.name], angles)
            if stands is None:
                stands = await self._find(tip, toucher, self._planned[setup.name], angles)
                # a frame of its own: nobody knows whether somebody has pushed the sphere
                course.parts[course.current] += 1
                work.news.next()
            else:
                await tip.come(toucher.over(stands.at(angles), stands.normal(angles)))
            await self._visit(toucher, stands, setup, visit, angles)

    def _toucher(
        self, tip: GuardedTip, stands: StandingSphere, angles: dict[str, float]
    ) -> SphereToucher:
        """With the stylus as a head has turned it."""
        shaft = stands.shaft(angles)
        return SphereToucher(tip, self._work.section, self._sphere.diameter, shaft, OVER_POST)

    async def _find(
        self,
        tip: GuardedTip,
        toucher: SphereToucher,
        planned: StandingSphere,
        angles: dict[str, float],
    ) -> StandingSphere:
        work, own = self._work, self._work.section
        centre, normal = planned.at(angles), planned.normal(angles)
        await tip.come(toucher.over(centre, normal))
        try:
            found = await toucher.find(centre, normal)
        except MissedSphereError as error:
            raise AbbeError(f"the sphere is not where the plan has it: {error}") from None
        stands = planned.found(angles, found.centre, found.radius)
        stands.require_near(planned, own.placing)
        toucher.require_radius(found.radius, "the sphere's")
        words = ", ".join(f"{v:.3f}" for v in found.centre.tolist())
        work.news.event("aligned", f"the sphere stands at {words} (X, Y, Z + tool, mm)")
        return stands

    async def _turn(self, tip: GuardedTip, setup: PlannedSetup, visit: int) -> dict[str, float]:
        """Turn the rotary axes to a visit's angles, from the side that the plan says; rad."""
        work = self._work
        target = work.course.here.target(visit)
        wanted = {a: q for a, q in target.items() if is_rotary(a)}
        senses = setup.senses()
        seen = await work.eyes.complete()
        beyond = radians(0.1 * work.space.beyond)
        before = {
            a: wanted[a] - float(senses[a][visit]) * beyond
            for a in turning_axes(setup)
            if float(senses[a][visit]) * (wanted[a] - seen.positions[a]) < 0.5 * beyond
        }
        turning = turning_axes(setup)
        off = {
            a: q for a, q in wanted.items() if a in turning or abs(seen.positions[a] - q) > _WITHIN
        }
        if before:
            await tip.turn(before)
        await tip.turn(off)
        seen = await work.eyes.complete()
        for a, q in wanted.items():
            if abs(seen.positions[a] - q) > _WITHIN:
                raise AbbeError(
                    f"{a} stands at {degrees(seen.positions[a]):.3f}° and was sent to "
                    f"{degrees(q):.3f}°"
                )
        return self._angles(seen)

    def _angles(self, seen: SeenMachine) -> dict[str, float]:
        return {a: q for a, q in seen.positions.items() if is_rotary(a)}

    async def _visit(
        self,
        toucher: SphereToucher,
        stands: StandingSphere,
        setup: PlannedSetup,
        visit: int,
        angles: dict[str, float],
    ) -> None:
        work = self._work
        words = ", ".join(f"{a} {degrees(q):.2f}°" for a, q in angles.items())
        place = stands.at(angles), stands.normal(angles)
        found = await one_sphere(
            work, toucher, f"the sphere of {setup.name} at {words}", visit, lambda _: place,
            stands.radius,
        )  # fmt: skip
        if found is None:
            return
        sphere, seen = found
        for a, q in self._angles(seen).items():
            if abs(q - angles[a]) > _STANDS_STILL:
                raise AbbeError(f"{a} has turned by {degrees(q - angles[a]):.3f}° meanwhile")
        target = int(work.course.here.order[visit])
        error = stands.error(angles, sphere.centre)
        directions, stated = setup.u[target], float(setup.sd[target])
        came = {a: float(setup.senses()[a][visit]) for a in turning_axes(setup)}
        work.take(
            setup, visit, stands.axes(angles), [float(error @ u) for u in directions],
            [float(np.hypot(stated, sphere.sd(u))) for u in directions], seen, directions=came,
            more=[{"form": round(sphere.form * 1e3, 3)} for _ in directions],
        )  # fmt: skip
