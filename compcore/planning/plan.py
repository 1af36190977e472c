"""A plan: set-ups in their order, what each leaves uncertain, and what stays undetermined."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.join import join_campaigns
from abbe.compcore.campaign.plan import from_the_bed
from abbe.compcore.errors import InputError
from abbe.compcore.fitting.usual_errors import USUAL
from abbe.compcore.linalg import threads_for
from abbe.compcore.planning.beside_boxes import Hindered, hindered
from abbe.compcore.planning.choice import Candidates, Chosen, Knowledge, choose
from abbe.compcore.planning.instruments import PlannedInstrument
from abbe.compcore.planning.knowledge import CHANGED, VolumeError, added, prior
from abbe.compcore.planning.planned_setup import PlannedSetup
from abbe.compcore.planning.setups.candidates import thought_of, unhindered
from abbe.compcore.planning.setups.lines import waves
from abbe.compcore.planning.setups.poses import planned_by_joints
from abbe.compcore.planning.setups.presets import PRESETS, Preset, filled, possible_of
from abbe.compcore.planning.targets import SurveyTask
from abbe.compcore.planning.undetermined import Undecided, undecided
from abbe.compcore.sentences import said

F64 = NDArray[np.float64]

WARM_UP = 3600.0
"""s that the machine moves as in use before the first reading; not part of the plan's time."""


@dataclass(frozen=True, eq=False)
class PlanStep:
    """One set-up of a plan.

    Attributes
    ----------
    setup
        The set-up, with its name.
    before, after
        Root of the mean square of the error that is left over the volume, without and with it,
        mm: standard uncertainty, three directions together.
    """

    setup: PlannedSetup
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class SurveyPlan:
    """Set-ups that make the corrected machine as sure as the time allows.

    Attributes
    ----------
    task
        What was planned for.
    steps
        The set-ups in their order.
    left
        What stays undetermined.
    presets
        Preset → what the same time spent on it would leave, mm, of those that this machine and time
        allow; none where not asked for.
    warm_up
        Before the first reading, s.
    stays
        Part of a machine's usual errors (`fitting.cautious`) that would stay over the volume, 0 …
        1; None for a machine that was fitted, of which more is known.
    """

    task: SurveyTask
    steps: tuple[PlanStep, ...]
    before: float
    left: tuple[Undecided, ...] = ()
    presets: Mapping[str, float] | None = None
    warm_up: float = WARM_UP
    stays: float | None = None
    left_out: tuple[str, ...] = ()
    """Set-ups of a preset for which there is no time."""
    placeless: tuple[str, ...] = ()
    """Instruments at hand of which no set-up lies within travels and keep-out boxes."""
    hindered: tuple[Hindered, ...] = ()
    """Set-ups that were not considered because the tool would enter a keep-out box."""

    @property
    def seconds(self) -> float:
        """How long all of it takes, s, without warming up."""
        return sum(step.setup.seconds for step in self.steps)

    @property
    def after(self) -> float:
        """What is left over the volume with all set-ups, mm."""
        return self.steps[-1].after if self.steps else self.before

    def rows(self) -> Campaign:
        """The campaign that the plan will give, values 0."""
        return campaign_of(self.task, [step.setup for step in self.steps], self.warm_up)


def campaign_of(task: SurveyTask, setups: Sequence[PlannedSetup], start: float = 0.0) -> Campaign:
    """The rows that named set-ups will give one after the other, on one clock, values 0."""
    parts = []
    for setup in setups:
        parts.append(setup.rows(task.machine, start))
        start += setup.seconds
    joined = join_campaigns(parts)
    conditions = replace(joined.conditions, run=None)
    return replace(joined, conditions=conditions)


_ELSE = "instruments that reach, room in the travels, more time"
_AT_ARMS = (
    "laser-tracker or tracker for poses over all joints, with --tool NAME=x,y,z where the "
    "reflector is while all joints stand at 0 (a tool that reaches back through the arm leaves no "
    "pose); laser, straightness, angle, rotary-calibrator along the axes that are there; more "
    "time, fewer keep-out boxes"
)


def plan_survey(
    task: SurveyTask,
    instruments: Sequence[PlannedInstrument],
    seconds: float,
    *,
    apart: tuple[int, ...] = (),
    changed: float = CHANGED,
    compare: bool = False,
    progress: Callable[[str], None] | None = None,
) -> SurveyPlan:
    """Choose set-ups for a machine, its instruments at hand and a time.

    Parameters
    ----------
    seconds
        The time there is, without warming up.
    apart
        Indices of the model's effects that are to be told apart, in place of a sure volume.
    changed
        Part of its believable size by which a fitted parameter may have changed since.
    compare
        Whether the presets are weighed as well.

    Raises
    ------
    InputError
        When nothing can be done: no set-up of these instruments fits travels and time.
    """
    tell = progress or (lambda _: None)
    with threads_for(1):
        tell("set-ups that can be done")
        thought = list(thought_of(task, instruments))
        found = list(unhindered(task, thought))
        fine = [s for i in instruments if i.key == "laser" for s in waves(task, i)]
        fine = [s for s in fine if task.space.hindrance(task.machine, s) is None]
        tell("what each of them adds")
        pool = Candidates(found, [added(task, s) for s in found])
        nothing = "no set-up of these instruments can be done on this machine in this time"
        if found and float(pool.seconds.min()) > seconds:
            raise InputError(
                nothing,
                field="time",
                found=f"{seconds / 60.0:g} min",
                expected=said("{n} min or more", n=int(np.ceil(float(pool.seconds.min()) / 60.0))),
            )
        if not found:
            raise InputError(
                nothing,
                field="instruments",
                found=", ".join(i.key for i in instruments),
                expected=_AT_ARMS if planned_by_joints(task) else _ELSE,
            )
        volume = VolumeError.of(task)
        start = Knowledge.beforehand(prior(task.model, changed), volume)
        aim = start
        if apart:
            aim = Knowledge(start.precision, VolumeError.of_parameters(task, apart))
        required = [Chosen(s, added(task, s)) for s in fine]
        chosen = choose(pool, aim, seconds, required=required, progress=tell)
        if not chosen:
            raise InputError(
                "what these instruments show makes nothing surer that the machine's axes can "
                "correct",
                field="instruments",
                found=", ".join(i.key for i in instruments),
                expected="more time, or others: along an axis a laser or a step gauge",
            )
        spent = sum(c.setup.seconds for c in chosen)
        if seconds - spent >= float(pool.seconds.min()):
            seconds = spent  # nothing else was worth its time
        placed = {s.instrument.key for s in (*found, *fine)}
        return replace(
            ordered(task, chosen, start),
            presets=_weighed(task, start, seconds) if compare else None,
            placeless=tuple(i.title for i in instruments if i.key not in placed),
            hindered=hindered(task, thought),
        )


def plan_preset(
    task: SurveyTask, preset: Preset, seconds: float, *, changed: float = CHANGED
) -> SurveyPlan:
    """The plan that spends a time on a preset, again and again where it is short.

    Raises
    ------
    InputError
        When the machine or the time allows nothing of it.
    """
    with threads_for(1):
        setups = possible_of(preset, task)
        roots = [added(task, s) for s in setups]
        numbers = filled(setups, seconds)
        if not numbers:
            raise InputError(
                "nothing of this preset can be done on this machine in this time",
                field="preset",
                found=preset.key,
                expected="another preset, more time",
            )
        start = Knowledge.beforehand(prior(task.model, changed), VolumeError.of(task))
        made = ordered(task, [Chosen(setups[i], roots[i]) for i in numbers], start)
        out = tuple(s.what for i, s in enumerate(setups) if i not in numbers)
        return replace(made, left_out=out, hindered=hindered(task, preset.setups(task)))


def _weighed(task: SurveyTask, start: Knowledge, seconds: float) -> dict[str, float]:
    found = {}
    for preset in PRESETS.values():
        setups = possible_of(preset, task)
        numbers = filled(setups, seconds)
        if not numbers:
            continue
        roots = [added(task, s) for s in setups]
        known = start
        for i in numbers:
            known = known.with_(roots[i], setups[i].runs)
        found[preset.key] = float(np.sqrt(known.variance))
    return found


_RANK = {
    "level": 0, "angle": 0, "laser": 1, "step-gauge": 1, "gauge-block": 1, "straightness": 2,
    "indicator": 2,
}  # fmt: skip


def ordered(task: SurveyTask, chosen: Sequence[Chosen], start: Knowledge) -> SurveyPlan:
    """The plan of chosen set-ups: named, in the order of ISO/TR 16907, 10.3, what each leaves."""
    axes = from_the_bed(task.machine)

    def rank(one: Chosen) -> tuple[int, int, int, str]:
        setup = one.setup
        rotary = setup.axis in task.machine.structure.rotary
        alone = 0 if setup.axis else 1
        place = axes.index(setup.axis) if setup.axis else len(axes)
        return (int(rotary), alone, place * 10 + _RANK.get(setup.instrument.key, 5), setup.what)

    known, steps = start, []
    for number, one in enumerate(sorted(chosen, key=rank), start=1):
        then = known.with_(one.root, one.setup.runs)
        name = f"{number:02d}_{one.setup.instrument.key.replace('-', '_')}"
        steps.append(
            PlanStep(
                replace(one.setup, name=name),
                float(np.sqrt(known.variance)),
                float(np.sqrt(then.variance)),
            )
        )
        known = then
    before = float(np.sqrt(start.variance))
    left = tuple(undecided(task, known, start))
    return SurveyPlan(task, tuple(steps), before, left, stays=_stays(task, chosen, start))


def _stays(task: SurveyTask, chosen: Sequence[Chosen], start: Knowledge) -> float | None:
    if task.model.covariance is not None or not len(start.precision):
        return None
    known = usual = Knowledge(start.precision / USUAL**2, VolumeError.of(task))
    for one in chosen:
        known = known.with_(one.root, one.setup.runs)
    if usual.variance <= 0.0:
        return None
    return float(np.sqrt(known.variance / usual.variance))
