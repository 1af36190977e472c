"""A gauge block or step gauge touched: top, side and end show where it lies, then face after face.

Every face is touched from the side to which it looks, in the middle of the step, along the gauge.
The tip comes down beside it and goes up again: between two faces it never goes across.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.artefacts.calibrated_gauge import CalibratedGauge
from abbe.compcore.errors import AbbeError, InputError
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.daemon.measure.machine_view import SeenMachine
from abbe.daemon.measure.probing.artefact import TouchedArtefact, TouchingWork
from abbe.daemon.measure.probing.guarded_tip import GuardedTip
from abbe.daemon.measure.probing.lying_gauge import LyingGauge
from abbe.drivers.touch_probe import NotTouchedError, TouchTravel

F64 = NDArray[np.float64]

_TIMES = 3
"""Touches of a face."""
_TRIES = 2
_FROM_END = 0.15
"""Part of a single step at which its top and side are touched, from both ends."""
_EDGE = 0.5
"""mm from an edge within which nothing is touched."""
_LEAST = 0.3
"""mm below which approach and placing make no sense."""
_SEEN = 0.2
"""Component along the gauge of an axis whose direction a touch tells."""


class GaugeTouching(TouchedArtefact):
    """The gauge of a measurement, in the places of its plan.

    Parameters
    ----------
    work
        What is shared.
    gauge
        The gauge.
    setups
        Its places.

    Raises
    ------
    InputError
        When they were not planned for this gauge, and when the tip does not find room.
    """

    def __init__(
        self, work: TouchingWork, gauge: CalibratedGauge, setups: Sequence[PlannedSetup]
    ) -> None:
        self._work, self._gauge = work, gauge
        own = work.section
        self._tip = 0.5 * own.tip
        self._planned = {s.name: LyingGauge.planned(gauge, s, own.shaft) for s in setups}
        steps = gauge.steps
        if len(steps) == 1:
            length = gauge.length
            self._stations = (_FROM_END * length, (1.0 - _FROM_END) * length)
            half = _FROM_END * length
        else:
            first, last = steps.mean(axis=1)[[0, -1]].tolist()
            self._stations = (first, last)
            half = 0.5 * float((steps[:, 1] - steps[:, 0])[[0, -1]].min())
        self._require_room(half)

    def _require_room(self, half: float) -> None:
        """Refuse a gauge about which the tip does not find room, by the key that helps.

        Parameters
        ----------
        half
            Half of what is touched from above, along the gauge, mm.
        """
        own, gauge = self._work.section, self._gauge
        narrow = min(half, 0.5 * gauge.width) - _EDGE
        if narrow <= _LEAST:
            raise _no_room(
                "gauge", f"{2.0 * (narrow + _EDGE):g} mm of its top to touch",
                f"at least {2.0 * (_EDGE + _LEAST):g} mm",
            )  # fmt: skip
        if own.placing >= narrow:
            raise _no_room("placing", own.placing, f"less than {narrow:.1f} mm")
        gap = gauge.gap - 3.0 * self._tip
        if own.approach + 2.0 * own.placing >= gap:
            approach, placing = gap - 2.0 * own.placing, 0.5 * (gap - own.approach)
            if approach > _LEAST:
                raise _no_room("approach", own.approach, f"less than {approach:.1f} mm")
            if placing > _LEAST:
                raise _no_room("placing", own.placing, f"less than {placing:.1f} mm")
            least = gauge.gap - 3.0 * _LEAST
            raise _no_room(
                "tip", own.tip, f"less than {least / 1.5:.1f} mm, approach and placing less, too"
                if least > 0.0 else "a gauge with more room between its steps",
            )  # fmt: skip
        clearance = 0.5 * gauge.height + own.approach + 2.0 * own.placing + own.tip
        if own.clearance <= clearance:
            raise _no_room("clearance", own.clearance, f"more than {clearance:.1f} mm")

    def look(self, tip: GuardedTip, setup: PlannedSetup) -> None:
        """As `TouchedArtefact.look`."""
        lies, own = self._planned[setup.name], self._work.section
        away = own.approach + 3.0 * own.placing + own.tip
        aside = 0.5 * self._gauge.width + away
        places = [lies.place(a, aside, h) for a in self._stations for h in (0.0, own.clearance)]
        for at, side in zip(self._gauge.places, self._gauge.sides, strict=True):
            beside = float(at + side * away)
            places += [lies.place(beside), lies.place(beside, 0.0, own.clearance)]
        for place in places:
            tip.look(place, place)

    async def measure(self, tip: GuardedTip, setup: PlannedSetup) -> None:
        """As `TouchedArtefact.measure`."""
        work, course = self._work, self._work.course
        lies = await self._align(tip, self._planned[setup.name])
        # a zero of its own: nobody knows what became of the gauge since its last rows
        course.parts[course.current] += 1
        work.news.next()
        visits = course.here
        for visit in list(visits.left):
            visits.expected = visit
            await self._visit(tip, lies, setup, visit)

    # where it lies

    async def _align(self, tip: GuardedTip, planned: LyingGauge) -> LyingGauge:
        work, own = self._work, self._work.section
        wide = own.placing
        await tip.begin(self._travel(wide))
        await tip.come(planned.place(self._stations[0], 0.0, own.clearance))
        half = 0.5 * self._gauge.height
        tops = [
            await self._coarse(tip, planned, planned.place(a, 0.0, half), planned.up, "the top")
            for a in self._stations
        ]
        lies = planned.by_top(tops[0], tops[1], self._tip)
        half = 0.5 * self._gauge.width
        sides = [
            await self._coarse(tip, lies, lies.place(a, half), lies.aside, "the side")
            for a in self._stations
        ]
        lies = lies.by_side(sides[0], sides[1], self._tip)
        end = await self._coarse(tip, lies, lies.place(0.0), -lies.along, "the first face")
        lies = lies.by_face(end, self._tip)
        lies.require_near(planned, own.placing)
        await tip.begin(self._travel(0.0))
        work.news.event("aligned", "top, side and first face show where the gauge lies")
        return lies

    async def _coarse(
        self, tip: GuardedTip, lies: LyingGauge, surface: F64, outward: F64, what: str
    ) -> F64:
        """Touch something that may lie `placing` off; the tip begins and ends at `clearance`."""
        own = self._work.section
        start = surface + (own.approach + own.placing + own.tip) * outward
        await tip.go(self._above(lies, start))
        await tip.go(start)
        try:
            found = await tip.touch(surface, outward)
        except NotTouchedError as error:
            raise AbbeError(f"{what} of the gauge is not where the plan has it: {error}") from None
        await tip.go(start)
        await tip.go(self._above(lies, start))
        return found

    def _above(self, lies: LyingGauge, place: F64) -> F64:
        """A place at the height of the ways between the faces."""
        high = float((place - lies.origin) @ lies.up)
        return np.asarray(place + (self._work.section.clearance - high) * lies.up)

    def _travel(self, wide: float) -> TouchTravel:
        own = self._work.section
        return TouchTravel(
            own.speed, own.touch_speed, self._tip, own.approach + wide, own.search + wide
        )

    # a face

    async def _visit(
        self, tip: GuardedTip, lies: LyingGauge, setup: PlannedSetup, visit: int
    ) -> None:
        work, own = self._work, self._work.section
        face = int(work.course.here.order[visit])
        name = f"face {self._gauge.faces[face]} of {setup.name}"
        coarse = ""
        for _ in range(_TRIES):
            seen = await work.eyes.complete()
            surface = lies.place(float(self._gauge.at(work.warm(seen))[face]))
            outward = float(self._gauge.sides[face]) * lies.along
            start = surface + (own.approach + own.tip) * outward
            await tip.go(self._above(lies, start))
            await tip.go(start)
            missed, touched = await self._touches(tip, surface, outward, start)
            if missed and own.missed == "stop":
                raise AbbeError(f"{name}: {missed}")
            await tip.go(self._above(lies, start))
            if missed:
                work.news.event("missed", f"{name}: {missed}; left out", visit=visit + 1)
                return
            then = await work.eyes.look()
            if work.eyes.missing(then):
                continue  # what was missing meanwhile is waited for, and the face touched again
            spread = float(np.ptp([lies.shown(p, face, self._tip) for p in touched])) * 1e3
            if spread <= own.max_form:
                self._take(setup, visit, lies, touched, then)
                return
            coarse = f"touches {spread:.1f} µm apart"
            work.news.event("unsteady", f"{name}: {coarse}; touched again", visit=visit + 1)
        work.news.event(
            "missed", f"{name}: {coarse or 'signals missing'}; left out", visit=visit + 1
        )

    async def _touches(
        self, tip: GuardedTip, surface: F64, outward: F64, start: F64
    ) -> tuple[str, list[F64]]:
        """Touch a face some times: why it was missed, or nothing; where the tip was."""
        own = self._work.section
        found: list[F64] = []
        for _ in range(_TIMES):
            try:
                found.append(await tip.touch(surface, outward))
            except NotTouchedError as error:
                if own.missed != "stop":
                    await tip.after_miss(start)
                return f"nothing is touched ({error})", found
            early = float((found[-1] - surface) @ outward) - self._tip
            if abs(early) > own.off:
                when = "early" if early > 0.0 else "late"
                return f"touched {abs(early):.2f} mm too {when}", found
        return "", found

    def _take(
        self,
        setup: PlannedSetup,
        visit: int,
        lies: LyingGauge,
        touched: Sequence[F64],
        seen: SeenMachine,
    ) -> None:
        work, gauge = self._work, self._gauge
        face = int(work.course.here.order[visit])
        shown = [lies.shown(p, face, self._tip) for p in touched]
        error = float(gauge.at(work.warm(seen))[face]) - float(np.mean(shown))
        place = dict(seen.positions)
        middle = np.mean(touched, axis=0)
        came = {}
        for k, a in enumerate("XYZ"):
            place[a] = float(middle[k] - setup.offset[k])
            component = float(lies.along[k])
            if abs(component) > _SEEN:
                came[a] = float(-np.sign(component) * gauge.sides[face])
        scatter = float(np.std(shown, ddof=1)) / len(shown) ** 0.5
        more: dict[str, str | float] = {}
        if gauge.sd and face:
            more = {"gauge": gauge.gauge(face), "gauge_sd": gauge.sd * 1e3}
        sd = float(np.hypot(setup.sd[face], scatter))
        work.take(setup, visit, place, [error], [sd], seen, directions=came, more=[more])


def _no_room(key: str, found: float | str, expected: str) -> InputError:
    return InputError(
        "the tip does not find room about this gauge",
        field=f"probing.{key}",
        found=found,
        expected=expected,
    )
