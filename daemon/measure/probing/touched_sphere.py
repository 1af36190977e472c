"""A sphere touched all round: over it, to it, about it from touch to touch, and over it again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.sphere import FittedSphere, fit_sphere
from abbe.compcore.errors import AbbeError
from abbe.compcore.planning.probing.touches import (
    OVER_PLATE,
    Stylus,
    about,
    directions,
    round_trip,
    unit,
)
from abbe.daemon.config.sections.probing import ProbingSection
from abbe.daemon.measure.probing.guarded_tip import GuardedTip
from abbe.drivers.touch_probe import NotTouchedError, TouchTravel

F64 = NDArray[np.float64]

_MORE = 1.2
"""The way between spheres is so much farther from them than where touches begin, at least."""


class MissedSphereError(AbbeError):
    """A sphere was not touched where it was expected.

    Attributes
    ----------
    way
        From the sphere's middle to where the tip is or may go straight back to, unit vector.
    searched
        Whether the tip is at the end of its search; else it has gone back.
    """

    def __init__(self, message: str, way: F64, *, searched: bool) -> None:
        super().__init__(message)
        self.way = way
        self.searched = searched


class SphereToucher:
    """Touches spheres of one size.

    Parameters
    ----------
    tip
        What is moved.
    section
        How.
    diameter
        Of the spheres, mm.
    shaft
        From the tip to the probe, machine axes; None: as the section says.
    over
        Farthest from where a sphere looks that it may be touched, rad.
    """

    def __init__(
        self,
        tip: GuardedTip,
        section: ProbingSection,
        diameter: float,
        shaft: F64 | None = None,
        over: float = OVER_PLATE,
    ) -> None:
        self._tip = tip
        self._section = section
        self._radius = 0.5 * section.tip
        self._reach = 0.5 * (diameter + section.tip)
        """From the middle of a sphere to the tip's when it touches."""
        self._ball = 0.5 * diameter
        x, y, z = unit(section.shaft if shaft is None else shaft.tolist()).tolist()
        self._over = over
        self._stylus = Stylus(self._radius, (x, y, z))

    @property
    def reach(self) -> float:
        """From a sphere's middle to the tip's when they touch, nominally, mm."""
        return self._reach

    @property
    def least_clearance(self) -> float:
        """The least `clearance` that keeps ways clear, mm."""
        own = self._section
        return _MORE * (self._reach + own.approach + own.placing)

    def require_radius(self, radius: float, whose: str) -> None:
        """Refuse a sphere of another size.

        Raises
        ------
        AbbeError
            When touched points lie at another radius (mm) than tip and sphere make together.
        """
        if abs(radius - self._reach) > self._section.off:
            raise AbbeError(
                f"the radius with the tip's is {radius:.3f} mm, and {self._reach:.3f} mm by "
                f"[probing] tip and {whose} diameter"
            )

    def over(self, centre: F64, normal: F64) -> F64:
        """Where the tip is on the way to a sphere."""
        return np.asarray(centre + self._section.clearance * normal)

    def places(self, centre: F64, normal: F64) -> list[F64]:
        """The farthest that the tip goes for a sphere that may lie `placing` off: to be looked at.

        Raises
        ------
        InputError
            When the stylus does not reach it.
        """
        own = self._section
        far = self._reach + own.approach + 2.0 * own.placing + self._radius
        ways = self._directions(normal)
        return [self.over(centre, normal), *(centre + far * d for d in ways)]

    async def find(self, centre: F64, normal: F64) -> FittedSphere:
        """A sphere that lies up to `placing` off where it is expected: touched coarsely, then well.

        The tip begins and ends over it.

        Raises
        ------
        MissedSphereError
            When it is not there.
        """
        wide = self._section.placing
        pole = self._directions(normal)[:1]
        await self._tip.begin(self._travel(wide))
        await self._tip.go(self.over(centre, normal))
        first = await self._around(centre, pole, wide)
        away = first[0] - centre - self._reach * pole[0]
        centre = centre + (away @ pole[0]) * pole[0]
        ways = self._directions(normal)
        points = await self._around(centre, ways, wide)
        await self._tip.go(self.over(centre, normal))
        rough = fit_sphere(np.array(points))
        await self._tip.begin(self._travel(0.0))
        return await self.measure(rough.centre, normal)

    async def measure(self, centre: F64, normal: F64, radius: float | None = None) -> FittedSphere:
        """A sphere that lies within `off` of where it is expected. The tip begins and ends over it.

        Parameters
        ----------
        radius
            Of the touched points about its middle, mm; None: fitted along.

        Raises
        ------
        MissedSphereError
            When it is not there.
        """
        await self._tip.go(self.over(centre, normal))
        ways = self._directions(normal)
        points = await self._around(centre, ways, 0.0)
        await self._tip.go(self.over(centre, normal))
        return fit_sphere(np.array(points), radius)

    async def leave(self, centre: F64, normal: F64, missed: MissedSphereError) -> None:
        """Take the tip from a sphere that was missed to over it."""
        own = self._section
        away = self._reach + own.approach
        if missed.searched:
            await self._tip.after_miss(centre + away * missed.way)
        pole = self._directions(normal)[0]
        for place in about(centre, missed.way, pole, away, self._reach + 0.5 * own.approach):
            await self._tip.go(place)
        await self._tip.go(self.over(centre, normal))

    def _directions(self, normal: F64) -> F64:
        return directions(normal, self._stylus, self._section.points, self._over)

    def _travel(self, wide: float) -> TouchTravel:
        own = self._section
        return TouchTravel(
            own.speed, own.touch_speed, self._radius, own.approach + wide, own.search + wide
        )

    async def _around(self, centre: F64, ways: F64, wide: float) -> list[F64]:
        """Touch along some directions, the first of which is the pole, and come back to it."""
        own = self._section
        away = self._reach + own.approach + wide
        least = self._reach + 0.5 * own.approach + wide
        found = []
        for place, way in round_trip(centre, ways, away, least):
            if way is None:
                await self._tip.go(place)
                continue
            try:
                point = await self._tip.touch(centre + self._ball * way, way)
            except NotTouchedError as error:
                raise MissedSphereError(
                    f"nothing is touched ({error})", way, searched=True
                ) from error
            early = float((point - centre) @ way) - self._reach
            if not wide and abs(early) > own.off:
                when = "early" if early > 0.0 else "late"
                raise MissedSphereError(
                    f"touched {abs(early):.2f} mm too {when}", way, searched=False
                )
            found.append(point)
        return found
