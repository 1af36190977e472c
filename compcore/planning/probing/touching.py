"""A machine's way through set-ups of a sphere that its own control touches, touch by touch.

The control's program does what `abbe measure` does where it moves the machine: the tip is drawn
back before anything turns, comes over the sphere, goes about it from touch to touch, and back.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import degrees

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.beyond import beyond_of
from abbe.compcore.planning.drawing_back import drawn_back
from abbe.compcore.planning.envelope import WorkingSpace
from abbe.compcore.planning.motion import TURN, ProgramStep, Way
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.probing.room import out_of
from abbe.compcore.planning.probing.standing_sphere import StandingSphere, turning_axes
from abbe.compcore.planning.probing.touches import OVER_POST, Stylus, directions, round_trip

F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Touching:
    """How a program touches a sphere; mm.

    Attributes
    ----------
    sphere, tip
        Diameters of the sphere and of the stylus's ball.
    points
        Touches of a sphere.
    approach, search
        Before and beyond the surface: by the smaller of both the sphere may stand off the plan.
    clearance
        From the sphere's middle to where the tip comes down.
    stands
        Where the axes stand, rotary axes as at the first target, when the tip is on the sphere's
        top, mm; None: as planned.
    """

    sphere: float
    tip: float
    points: int = 5
    approach: float = 3.0
    search: float = 3.0
    clearance: float = 50.0
    stands: tuple[float, float, float] | None = None


def touching_steps(
    machine: Machine, setups: Sequence[PlannedSetup], space: WorkingSpace, touching: Touching
) -> tuple[ProgramStep, ...]:
    """All steps for some set-ups of a sphere.

    Raises
    ------
    InputError
        Naming set-up and axis, for a move outside the travels or through a keep-out box, and where
        the stylus does not reach the sphere.
    """
    if len(setups) > 1:
        # their touches would be one file, and be taken for those of one sphere
        raise InputError(
            "a program touches the sphere of one set-up, into a file of its own",
            field="setup",
            found=", ".join(s.name for s in setups),
            expected="--setup NAME",
        )
    return tuple(_TouchingWay(machine, space, touching).through(setups))


class _TouchingWay(Way):
    """The way through a program that touches, checked move by move."""

    def __init__(self, machine: Machine, space: WorkingSpace, touching: Touching) -> None:
        super().__init__(machine, space, None)
        self._touching = touching
        self._reach = 0.5 * (touching.sphere + touching.tip)

    def _setup(self, setup: PlannedSetup) -> Iterator[ProgramStep]:
        own, machine = self._touching, self._machine
        stands = self._standing(setup)
        order, _ = setup.visits()
        senses, turning = setup.senses(), turning_axes(setup)
        more = beyond_of(setup, self._space.beyond)
        back, height = drawn_back(machine, setup.offset)
        yield from self._back(setup, {back: height})
        before: dict[str, float] = {}
        for i, k in enumerate(order.tolist()):
            angles = {a: float(q[k]) for a, q in setup.targets.items() if is_rotary(a)}
            sense = {a: float(senses[a][i]) for a in turning}
            over = self._beside(stands, angles, own.clearance * stands.normal(angles))
            if not self._at:
                self._at = dict(over) | {back: height}
            late = [a for a in turning if not i or self._wrong(a, angles[a], sense[a], before[a])]
            if late:
                beyond = {a: angles[a] - sense[a] * more[a] for a in late}
                yield self._move(setup, beyond, TURN)
            yield self._move(setup, angles)
            yield from self._across(setup, over | {back: height}, (back,))
            if not i:
                yield ProgramStep("stop", f"probe in, sphere on the table: {setup.what}")
            self._number += 1
            words = ", ".join(f"{a} {degrees(q):.3f}" for a, q in angles.items())
            yield ProgramStep("note", f"sphere {self._number}: {words}")
            yield self._guarded(setup, over)
            yield from self._around(setup, stands, angles)
            yield self._guarded(setup, over)
            yield self._move(setup, {back: height})
            before = sense

    def _standing(self, setup: PlannedSetup) -> StandingSphere:
        """Where the sphere stands: as planned, or where a person has found its top."""
        planned = StandingSphere.planned(self._machine, setup, out_of(setup.offset).tolist())
        own = self._touching
        if own.stands is None:
            return planned
        first = int(setup.visits()[0][0])
        angles = {a: float(q[first]) for a, q in setup.targets.items() if is_rotary(a)}
        top = np.asarray(own.stands) + np.asarray(setup.offset)
        return planned.found(angles, top - self._reach * planned.shaft(angles), self._reach)

    def _around(
        self, setup: PlannedSetup, stands: StandingSphere, angles: dict[str, float]
    ) -> Iterator[ProgramStep]:
        own = self._touching
        x, y, z = stands.shaft(angles).tolist()
        stylus = Stylus(0.5 * own.tip, (x, y, z))
        ways = directions(stands.normal(angles), stylus, own.points, OVER_POST)
        away, least = self._reach + own.approach, self._reach + 0.5 * own.approach
        for place, way in round_trip(np.zeros(3), ways, away, least):
            here = self._beside(stands, angles, place)
            if way is None:
                yield self._guarded(setup, here)
                continue
            end = self._beside(stands, angles, (self._reach - own.search) * way)
            step = self._move(setup, end)
            every = {a: self._at[a] for a in self._machine.structure.axes}
            yield replace(step, kind="touch", setup=setup.name, number=self._number, stands=every)
            yield self._move(setup, here)

    def _guarded(self, setup: PlannedSetup, to: dict[str, float]) -> ProgramStep:
        return replace(self._move(setup, to), guarded=True)

    def _beside(
        self, stands: StandingSphere, angles: dict[str, float], by: F64
    ) -> dict[str, float]:
        """Where X, Y, Z stand with the tip so far beside the sphere's middle, machine axes."""
        place = stands.axes(angles)
        return {a: place[a] + float(by[k]) for k, a in enumerate("XYZ")}
