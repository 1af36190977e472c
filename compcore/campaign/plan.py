"""A plan of measurements in the order of ISO/TR 16907, 10.3, with steps by the rule of steps.

What is measured first must not hold what is measured later: angles before positioning and
straightness, these before squareness; of rotary axes tilt, then radial and axial motion, then
positioning, then the place of the line. The axis nearer the bed comes first, linear before rotary
axes: the latter are followed by X, Y, Z.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from abbe.compcore.campaign.sampling import HELD, amplitude_held, step_for
from abbe.compcore.errors import InputError
from abbe.compcore.machine.machine import Axis, Machine, own_component
from abbe.compcore.sentences import said

_TARGETS_PER_METRE = 5
_FEWEST_TARGETS = 5
"""ISO 230-2: at least five targets a metre, and at least five."""
_USUAL = 14
"""Steps over the travel where no wave is asked for."""
_USUAL_ANGLE = math.radians(15.0)
_MOST_TARGETS = 200
"""Beyond this a long line in coarse steps and a short one in fine steps take its place."""
_WAVES = 5
"""Of a wave, how many a short line covers."""
RUNS = 5
"""Both ways, by ISO 230-2."""
_NICE = (1.0, 2.0, 2.5, 5.0)


@dataclass(frozen=True, slots=True)
class PlannedSteps:
    """Targets along an axis.

    Attributes
    ----------
    axis
        The axis that moves.
    first, last
        Its ends, mm or rad.
    step
        mm or rad.
    uneven
        Whether every target is moved by a random part of a step, so that waves which the step does
        not resolve become noise in place of other waves (ISO 230-2).
    wave
        The shortest wave that is to be seen with them, mm or rad; None: none was asked for.
    """

    axis: str
    first: float
    last: float
    step: float
    uneven: bool = False
    wave: float | None = None

    @property
    def targets(self) -> int:
        """How many."""
        return math.floor((self.last - self.first) / self.step + 1e-6) + 1

    @property
    def shortest(self) -> float:
        """The wave from which on waves are seen as what they are, mm or rad."""
        return 2.0 * self.step

    @property
    def held(self) -> float | None:
        """Part of the asked-for wave's amplitude that straight lines between the targets hold."""
        return None if self.wave is None else amplitude_held(self.step, self.wave)


@dataclass(frozen=True, slots=True)
class PlannedMeasurement:
    """One line of a plan.

    Attributes
    ----------
    axis
        The axis that moves; for squareness the second one.
    what
        ``angles``, ``positioning``, ``straightness``, ``squareness``, ``tilt``, ``radial and
        axial``, ``location``.
    motions
        Error motions and constants that it gives: ``E_AX`` …, ``E_C0Y``.
    instrument
        What commonly measures them.
    steps
        Targets; more than one where a wave needs finer steps than the whole travel can have. None
        for a squareness, which is in lines measured already or in a square.
    at
        Other axis → where it stands, mm or rad.
    runs
        How often each way.
    """

    axis: str
    what: str
    motions: tuple[str, ...]
    instrument: str
    steps: tuple[PlannedSteps, ...]
    at: Mapping[str, float]
    runs: int


def measurement_plan(
    machine: Machine, waves: Mapping[str, float] | None = None, held: float = HELD
) -> tuple[PlannedMeasurement, ...]:
    """What to measure on a machine, and in which order.

    Parameters
    ----------
    waves
        Axis → the shortest wave that is to be seen, mm (rotary: rad).
    held
        Part of its amplitude that a table with these steps shall hold.

    Raises
    ------
    InputError
        For an axis that the machine lacks, and a wave that is longer than its travel.
    """
    waves = waves or {}
    for axis, wave in waves.items():
        own = machine.axis(axis, "wave")
        if not 0.0 < wave <= 2.0 * own.half_travel:
            raise InputError(
                "not a wave along this axis",
                field=f"wave {axis}",
                found=math.degrees(wave) if own.rotary else wave,
                expected="longer than 0, and no longer than the travel",
            )
    plan: list[PlannedMeasurement] = []
    done: list[str] = []
    order = from_the_bed(machine)
    for name in (a for a in order if not machine.axes[a].rotary):
        plan += _linear(machine, name, done, line_steps(machine.axes[name], waves.get(name), held))
        done.append(name)
    for name in (a for a in order if machine.axes[a].rotary):
        plan += _rotary(machine, name, line_steps(machine.axes[name], waves.get(name), held))
    return tuple(plan)


def from_the_bed(machine: Machine) -> list[str]:
    """All axes, the nearer to the bed the earlier; of two alike the workpiece's first."""
    structure = machine.structure
    sides = (structure.workpiece_side[::-1], structure.tool_side)
    ranked = [(i, side, a) for side, axes in enumerate(sides) for i, a in enumerate(axes)]
    return [a for _, _, a in sorted(ranked)]


def line_steps(axis: Axis, wave: float | None, held: float = HELD) -> tuple[PlannedSteps, ...]:
    """Targets along an axis: usual ones, and a short line where a wave needs finer ones.

    Parameters
    ----------
    wave
        The shortest wave that is to be seen, mm or rad; None: none in particular.
    held
        Part of its amplitude that straight lines between the targets shall hold.
    """
    low, high = axis.travel
    length = high - low
    if axis.rotary:
        step = min(_USUAL_ANGLE, length / (_FEWEST_TARGETS - 1))
    else:
        least = max(_FEWEST_TARGETS, math.ceil(length * _TARGETS_PER_METRE / 1000.0))
        step = _nice(min(length / _USUAL, length / (least - 1)))
    if wave is None:
        return (PlannedSteps(axis.name, low, high, step),)
    fine = _nice_angle(step_for(wave, held)) if axis.rotary else _nice(step_for(wave, held))
    if length / fine <= _MOST_TARGETS:
        return (PlannedSteps(axis.name, low, high, min(step, fine), wave=wave),)
    short = min(_WAVES * wave, length)
    first = axis.middle - 0.5 * short
    return (
        PlannedSteps(axis.name, low, high, step, uneven=True),
        PlannedSteps(axis.name, first, first + short, fine, wave=wave),
    )


def _nice(step: float) -> float:
    """The largest of 1, 2, 2.5, 5 · 10^k that is not above a step."""
    power = 10.0 ** math.floor(math.log10(step))
    return max(k * power for k in _NICE if k * power <= step * (1.0 + 1e-9))


def _nice_angle(step: float) -> float:
    """The largest part of a degree, or number of degrees that divides 360, not above a step."""
    degrees = math.degrees(step)
    whole = [d for d in range(1, 46) if 360 % d == 0 and d <= degrees * (1.0 + 1e-9)]
    return math.radians(whole[-1]) if whole else math.radians(_nice(degrees))


def _linear(
    machine: Machine, name: str, done: Sequence[str], steps: tuple[PlannedSteps, ...]
) -> Iterator[PlannedMeasurement]:
    own = own_component(name)
    others = [k for k in "XYZ" if k != own]
    at = _standing(machine, name)
    roll = {"X": "A", "Y": "B", "Z": "C"}[own]
    tilts = [k for k in "ABC" if k != roll]
    coarse = steps[:1]
    yield PlannedMeasurement(
        name, said("angles"), tuple(f"E_{k}{name}" for k in (*tilts, roll)),
        said(
            "laser with angle optics or autocollimator; roll: levels, or two straightnesses apart"
        ),
        coarse, at, 2,
    )  # fmt: skip
    yield PlannedMeasurement(
        name,
        said("positioning"),
        (f"E_{own}{name}",),
        said("laser interferometer, step gauge"),
        steps,
        at,
        RUNS,
    )
    yield PlannedMeasurement(
        name, said("straightness"), tuple(f"E_{k}{name}" for k in others),
        said("straightedge, laser with straightness optics"), coarse, at, 2,
    )  # fmt: skip
    for first in done:
        one = own_component(first)
        if one == own:
            continue
        about = "ABC"["XYZ".index(_third(one, own))]
        motion = said("{motion} to {axis}", motion=f"E_{about}0{name}", axis=first)
        yield PlannedMeasurement(
            name, said("squareness"), (motion,),
            said("square, or a laser on both diagonals of the {plane} plane", plane=one + own), (),
            _standing(machine, name, first), 2,
        )  # fmt: skip


def _rotary(
    machine: Machine, name: str, steps: tuple[PlannedSteps, ...]
) -> Iterator[PlannedMeasurement]:
    own = own_component(name)
    along = "XYZ"["ABC".index(own)]
    across = [k for k in "XYZ" if k != along]
    tilts = [k for k in "ABC" if k != own]
    at = _standing(machine, name)
    coarse = steps[:1]
    yield PlannedMeasurement(
        name, said("tilt"), tuple(f"E_{k}{name}" for k in tilts),
        said("levels, or a sphere at two heights (R-test)"), coarse, at, 2,
    )  # fmt: skip
    yield PlannedMeasurement(
        name, said("radial and axial"), tuple(f"E_{k}{name}" for k in (*across, along)),
        said("sphere and indicators, R-test"), coarse, at, 2,
    )  # fmt: skip
    yield PlannedMeasurement(
        name, said("positioning"), (f"E_{own}{name}",),
        said("polygon and autocollimator, rotary indexer"), steps, at, RUNS,
    )  # fmt: skip
    constants = [f"E_{k}0{name}" for k in (*across, *tilts)]
    yield PlannedMeasurement(
        name, said("location"), tuple(constants),
        said("R-test or ball bar, X, Y, Z following (abbe iso10791)"), coarse, at, 2,
    )  # fmt: skip


def _third(one: str, two: str) -> str:
    return next(k for k in "XYZ" if k not in (one, two))


def _standing(machine: Machine, *moving: str) -> dict[str, float]:
    """Where the axes that do not move stand: the middle, rotary axes at 0 where they reach it."""
    return {
        a: 0.0
        if machine.axes[a].rotary and machine.axes[a].travel[0] <= 0.0 <= machine.axes[a].travel[1]
        else float(np.round(machine.axes[a].middle, 6))
        for a in machine.structure.axes
        if a not in moving
    }
