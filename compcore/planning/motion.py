"""What a machine does for a plan, move by move: the programme of which dialects make their text.

A target is met from the side that the plan says: where an axis would come from the other one, it
goes beyond first, stands, and comes back. Between set-ups the tool is drawn back along the axis
that is nearest to it, and the program stops for the instrument to be set up; before the first
target once more for what has to be aligned or put on there. An arm has no such
axis: it goes straight to the next set-up, or over the pose in which its joints stand at 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from abbe.compcore.errors import InputError
from abbe.compcore.figures.places import reaches_by_joints
from abbe.compcore.machine.machine import Machine
from abbe.compcore.machine.structure import is_rotary
from abbe.compcore.planning.beyond import beyond_of
from abbe.compcore.planning.drawing_back import drawn_back, draws_back
from abbe.compcore.planning.envelope import WorkingSpace
from abbe.compcore.planning.following_legs import legs_between
from abbe.compcore.planning.nudge import nudge_of
from abbe.compcore.planning.planned_setup import PlannedSetup

TURN = 0.5
"""s that the machine stands beyond a target before it comes back. A control that rounds corners
would turn before it gets there, and who follows the machine would not see that it went beyond."""
_ROUNDING = 1e-6
_NEAR = 1e-9


@dataclass(frozen=True, slots=True)
class ProgramStep:
    """One step of a program.

    Attributes
    ----------
    kind
        ``note``: words; ``stop``: words, waits for a person while the tool is drawn back;
        ``there``: the same, before the first target; ``move``: straight, at feed; ``target``:
        stands still there and is read; ``touch``: straight on until the probe touches.
    text
        Of notes and of what a person is waited for.
    at
        Of moves and targets: axis → position, mm or rad.
    number
        Of a target, or of the sphere that is touched, counted through the program from 1.
    seconds
        How long it stands where it is then; of a move mostly 0.
    setup, directions
        Of a target: its set-up, and axis → the sense in which it arrived, 1 or −1.
    stands
        Of a touch: every axis → where it stands at the latest, mm or rad.
    guarded
        Of a move: the probe must not touch anything on it.
    turning
        Of a move: rotary axes alone move.
    """

    kind: Literal["note", "stop", "there", "move", "target", "touch"]
    text: str = ""
    at: Mapping[str, float] = field(default_factory=dict)
    number: int = 0
    seconds: float = 0.0
    setup: str = ""
    directions: Mapping[str, int] = field(default_factory=dict)
    stands: Mapping[str, float] = field(default_factory=dict)
    guarded: bool = False
    turning: bool = False


def steps_of(
    machine: Machine,
    setups: Sequence[PlannedSetup],
    space: WorkingSpace,
    stands: float | None = None,
) -> tuple[ProgramStep, ...]:
    """All steps for some set-ups.

    Parameters
    ----------
    stands
        How long it stands at each target, s; None: as long as the set-up's instrument needs.

    Raises
    ------
    InputError
        Naming set-up, target and axis, for a move outside the travels or through a keep-out box.
    """
    return tuple(Way(machine, space, stands).through(setups))


class Way:
    """The way through a program, checked move by move."""

    def __init__(self, machine: Machine, space: WorkingSpace, stands: float | None) -> None:
        self._machine = machine
        self._space = space
        self._stands = stands
        self._at: dict[str, float] = {}
        self._number = 0

    def through(self, setups: Sequence[PlannedSetup]) -> Iterator[ProgramStep]:
        """Its steps, set-up after set-up."""
        for setup in setups:
            yield ProgramStep("note", f"set-up {setup.name}: {setup.what}")
            yield ProgramStep("note", f"{setup.instrument.title}, tool {setup.tool}")
            for title, place in setup.optics.items():
                where = ", ".join(f"{v:.0f}" for v in place)
                yield ProgramStep("note", f"{title} at {where} (X, Y, Z + tool, mm)")
            yield from self._setup(setup)

    def _setup(self, setup: PlannedSetup) -> Iterator[ProgramStep]:
        order, _ = setup.visits()
        senses = setup.senses()
        more = beyond_of(setup, self._space.beyond)
        moving = list(more)
        rest: dict[str, float] = {}
        if draws_back(self._machine):
            rest = dict([drawn_back(self._machine, setup.offset)])
        yield from self._back(setup, rest)
        before: dict[str, float] = {}
        for i, k in enumerate(order.tolist()):
            target = {a: float(q[k]) for a, q in setup.targets.items()}
            sense = {a: float(senses[a][i]) for a in moving}
            if i == 0:
                first = target | {a: target[a] - sense[a] * more[a] for a in moving}
                high = first | rest
                if not self._at:
                    self._at = dict(high)
                yield from self._across(setup, high, tuple(rest))
                yield ProgramStep("stop", f"set up the instrument: {setup.what}")
                yield self._move(setup, first, TURN)
                if setup.instrument.there:
                    yield ProgramStep("there", f"{setup.instrument.there}: {setup.what}")
            else:
                for leg in legs_between(self._machine, setup, self._at, target):
                    yield self._move(setup, leg)
                late = [a for a in moving if self._wrong(a, target[a], sense[a], before[a])]
                if late:
                    beyond = {a: target[a] - sense[a] * more[a] for a in late}
                    if setup.instrument.held:  # all together: none may stay behind
                        beyond = target | beyond
                    yield self._move(setup, beyond, TURN)
            yield self._move(setup, target)
            seconds = setup.instrument.reading if self._stands is None else self._stands
            if i == 0:
                yield from self._nudged(setup, target, seconds)
            self._number += 1
            yield ProgramStep(
                "target", at=target, number=self._number, seconds=seconds, setup=setup.name,
                directions={a: int(s) for a, s in sense.items()},
            )  # fmt: skip
            before = sense
        if rest:
            yield self._move(setup, rest)

    def _back(self, setup: PlannedSetup, rest: Mapping[str, float]) -> Iterator[ProgramStep]:
        """The tool drawn back, also from where nobody knows that it is."""
        if not rest:
            if not self._at:
                yield ProgramStep("note", "the way to the first pose must be free")
        elif self._at:
            yield self._move(setup, rest)
        else:
            ((back, height),) = rest.items()
            yield ProgramStep("note", f"the way of {back} to {height:.3f} must be free")
            yield ProgramStep("move", at=dict(rest))

    def _nudged(
        self, setup: PlannedSetup, target: Mapping[str, float], seconds: float
    ) -> Iterator[ProgramStep]:
        """The small way across the line and back, both ends met from one side: without play."""
        aside = nudge_of(self._machine, setup, self._space.nudge)
        if not aside:
            return
        words = ", ".join(f"{a} {by:+.3f} mm" for a, by in aside.items())
        yield ProgramStep("note", f"{words} and back: {setup.instrument.title} has to show it")
        before = {a: target[a] - by for a, by in aside.items()}
        yield self._move(setup, before, TURN)
        yield self._move(setup, {a: target[a] + by for a, by in aside.items()}, seconds)
        yield self._move(setup, before, TURN)
        yield self._move(setup, {a: target[a] for a in aside})

    def _across(
        self, setup: PlannedSetup, to: Mapping[str, float], back: tuple[str, ...]
    ) -> tuple[ProgramStep, ...]:
        """The way to the next set-up with the tool drawn back: straight, or around what stands.

        One axis after the other, or along an edge of the travels; of an arm over the pose in which
        its joints stand at 0. Raises as `_move` where none of these is free.
        """
        start = dict(self._at)
        first: InputError | None = None
        for way in self._ways(to, back):
            try:
                return tuple(self._move(setup, leg) for leg in way)
            except InputError as error:
                self._at, first = dict(start), first or error
        raise first or AssertionError

    def _ways(
        self, to: Mapping[str, float], back: tuple[str, ...]
    ) -> Iterator[list[Mapping[str, float]]]:
        """Ways to a place, the shortest first; legs as axis → position."""
        yield [to]
        level = [a for a in to if a not in back and not is_rotary(a)]
        joints = [a for a in self._machine.structure.tool_side if is_rotary(a)]
        if reaches_by_joints(self._machine):
            home = {a: float(self._machine.axes[a].clamp(np.zeros(1))[0]) for a in joints}
            yield [home, to]
        for axis in level:
            yield [{axis: to[axis]}, to]
        for axis in level:
            low, high = self._edges(axis)
            near_low = abs(low - to[axis]) <= abs(high - to[axis])
            others = {a: to[a] for a in level if a != axis}
            for edge in (low, high) if near_low else (high, low):
                yield [{axis: edge}, others, to]

    def _edges(self, axis: str) -> tuple[float, float]:
        low, high = self._machine.axes[axis].travel
        inside = min(1.0, 0.01 * (high - low))
        return low + inside, high - inside

    def _wrong(self, axis: str, target: float, sense: float, before: float) -> bool:
        """Whether an axis would come to a target from the other side, or has not come to it."""
        way = target - self._at[axis]
        return way * sense < 0.0 if abs(way) > _NEAR else sense != before

    def _move(
        self, setup: PlannedSetup, to: Mapping[str, float], seconds: float = 0.0
    ) -> ProgramStep:
        then = self._at | dict(to)
        for axis, value in to.items():
            low, high = self._machine.axes[axis].travel
            if not low - _ROUNDING <= value <= high + _ROUNDING:
                raise InputError(
                    f"{axis} would leave its travel on the way to target {self._number + 1}",
                    field=f"setups.{setup.name}",
                    found=round(math.degrees(value) if is_rotary(axis) else value, 4),
                    expected="a position within the travel, with room to come from both sides",
                )
        turns = any(is_rotary(a) and abs(then[a] - v) > _NEAR for a, v in self._at.items())
        way = {a: np.array([self._at[a], then[a]]) for a in self._at}
        hit = self._space.entered(self._machine, way, setup.offset, turns=turns)
        if hit is not None:
            raise InputError(
                f"the tool would enter keep-out box {hit} on the way to target {self._number + 1}",
                field=f"setups.{setup.name}",
                expected="a free way; plan with the box, or change the order of set-ups",
            )
        turning = turns and all(
            is_rotary(a) or abs(then[a] - v) <= _NEAR for a, v in self._at.items()
        )
        self._at = then
        return ProgramStep("move", at=dict(to), seconds=seconds, turning=turning)
