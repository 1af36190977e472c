"""From a machine and a campaign to a model: diagnose, add, look again, until the verdict.

Every step is one effect more, fitted together with all others, and is kept only if blocks of the
campaign that are left out of the fit (set-ups, stretches of time, places) are predicted better with
it. At the end each effect that was added is tried without: what later ones made superfluous goes.
An end that foretells worse than a step on the way is left for that step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.campaign.switched_units import switched_thermometers
from abbe.compcore.diagnosis.judging.foretelling import WORTH
from abbe.compcore.diagnosis.mistaken import mistakes
from abbe.compcore.diagnosis.screening.body_motions import motion, of_a_body
from abbe.compcore.diagnosis.screening.candidates import ALONG_AN_AXIS, RIGID
from abbe.compcore.diagnosis.stepwise.best_on_the_way import best_on_the_way, foretells_better
from abbe.compcore.diagnosis.stepwise.describing import describe
from abbe.compcore.diagnosis.stepwise.growing_model import NO_BETTER, GrowingModel, Progress
from abbe.compcore.diagnosis.stepwise.held_near_zero import held_near_zero
from abbe.compcore.diagnosis.stepwise.kept_from_before import accused_steps, kept_from_before
from abbe.compcore.diagnosis.stepwise.step import Course, Step, leaves_noise
from abbe.compcore.diagnosis.stepwise.unseen import UnseenCampaign
from abbe.compcore.diagnosis.stepwise.warmth import (
    MOST_TRIED,
    bodies,
    detail,
    lag,
    regress,
    sharpen,
)
from abbe.compcore.diagnosis.stepwise.whole_body import whole_body
from abbe.compcore.diagnosis.stepwise.whole_chain import whole_chain, whole_weight
from abbe.compcore.diagnosis.stepwise.within_noise import take_out_noise
from abbe.compcore.diagnosis.verdict import Diagnosis, lacking
from abbe.compcore.distributions import chi2_limit
from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.catalogue.gravity import GravityFlexure
from abbe.compcore.errors import InputError
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import joined, said

MOST_STEPS = 60
"""A model that needs more effects is looked at by its user first."""

_CHANCE = 1e-4
"""Chance of so large a χ² from which on what is left is not all noise."""

_COLUMNS = 100
"""Parameters that the models on the way have, about: for the choice of threads."""


def to_the_verdict(
    model: Model,
    campaign: Campaign,
    *,
    unseen: UnseenCampaign | None = None,
    on_step: Callable[[Step], None] = lambda _: None,
    again: Callable[[Step], None] = lambda _: None,
    instead: Callable[[Step, Step], None] = lambda _, __: None,
    progress: Progress = lambda _: None,
) -> Course:
    """Add what the diagnosis establishes until it establishes nothing more.

    Parameters
    ----------
    model
        Where to begin; it may have no effects at all.
    campaign
        The measurements.
    unseen
        A campaign that is never fitted; None without one. Where it ends predicted surely worse
        than on the way, all is begun anew, and what predicts it worse is refused.
    on_step
        Called with every step as soon as it is made.
    again
        Called before all is begun anew, with the step after which it was predicted best.
    instead
        Called where another way foretells better, with the ends of both, before its steps.
    progress
        Called with a few words at the start of each stage.

    Raises
    ------
    FitError
        As `diagnose`.
    InputError
        Where the campaign's writer seems to have mistaken a unit, a sign or a thermometer.
    """
    progress("mistakes in the campaign")
    found: list[str] = list(switched_thermometers(campaign, model.machine))
    if not found and (mistaken := mistakes(model, campaign)):
        found = [*(m.text for m in mistaken), mistaken[0].without.words()]
    if found:
        raise InputError(
            said("a mistake in the campaign would be taken for the machine's; nothing was added"),
            found=joined(found),
            expected=said(
                "that to be put right, and diagnosed again; if it is none, diagnose without "
                "--apply, and add what is missing by hand"
            ),
        )

    def followed(held_out: UnseenCampaign | None = None) -> Course:
        growing = GrowingModel(model, campaign, on_step, progress, held_out)
        course = _followed(growing)
        if not growing.of_bodies or _is_noise(course.last.result):
            return course
        progress("another way: one cause after another")
        other = GrowingModel(model, campaign, lambda _: None, progress, held_out, bodies=False)
        found = _followed(other)
        if not _foretells_better(found.last, course.last):
            return course
        instead(course.last, found.last)
        for step in found.steps:
            on_step(step)
        return found

    def ended(course: Course) -> Course:
        if (best := best_on_the_way(course.steps)) is not None:
            progress("back to the step that foretells best")
            back = replace(best, action="went back", effect=None)
            on_step(back)
            found = replace(lacking(back.result), strays=course.diagnosis.strays)
            course = replace(course, steps=(*course.steps, back), diagnosis=found)
        for more in accused_steps(model, course.steps[0], course.last):
            on_step(more)
            course = replace(course, steps=(*course.steps, more))
        step = kept_from_before(model, course.steps[0], course.last, unseen)
        step = step or held_near_zero(course.last, unseen)
        if step is None:
            return course
        on_step(step)
        return replace(course, steps=(*course.steps, step))

    with threads_for(campaign.n * _COLUMNS):
        course = followed()
        if unseen is None:
            return ended(course)
        models = [step.result.model for step in course.steps]
        best = unseen.best(models)
        if not unseen.spoilt(models[best], models[-1]):
            return ended(course)
        again(course.steps[best])
        return ended(followed(unseen))


def _is_noise(result: FitResult) -> bool:
    """Whether no more is left than stated or repeated uncertainties say, by χ²."""
    thin = result.thin
    return not thin.uncertainty.open and thin.chi2 <= chi2_limit(_CHANCE, max(1, thin.dof))


def _foretells_better(one: Step, other: Step) -> bool:
    """Whether one end predicts left-out blocks surely better.

    Not by causes that the other one does not need: they may be what imitates the motions of the
    axes.
    """
    thin = other.result.thin
    machine, there = thin.model.machine, set(thin.model.effects)
    more = [e for e in one.result.model.effects if e not in there and e.kind != "formula"]
    if not all(of_a_body(e, machine) for e in more):
        return False
    return foretells_better(one.held_out.left.residual, other.held_out.left.residual, other.result)


def _followed(growing: GrowingModel) -> Course:
    diagnosis = growing.diagnosed()
    while len(growing.steps) < MOST_STEPS:
        if any(f(growing, diagnosis) for f in (whole_body, whole_chain, whole_weight)):
            diagnosis = growing.diagnosed()
        found = [e.found.candidate.effect for e in diagnosis.established]
        new = _motions_first([e for e in found if not growing.refused_now(e)])
        read = [e for e in new if not e.of_the_clock]
        clock = [e for e in new if read and e.of_the_clock]
        if new and not read and bodies(growing):
            diagnosis = growing.diagnosed()
            continue
        if (
            growing.add_all(read or new)
            or _add_another(growing, diagnosis)
            # what reads a signal was taken by none of the blocks: what reads the clock is no worse
            or growing.add_all(clock)
        ):
            lag(growing)
        elif not (
            detail(growing, diagnosis)
            or sharpen(growing, diagnosis)
            or _complete_motions(growing, diagnosis)
            or _complete_joints(growing, diagnosis)
            or growing.prune()
            or (
                # a thermometer's own noise, times a scale's expansion, follows other thermometers
                not leaves_noise(growing.last.result)
                and (regress(growing, diagnosis) or describe(growing, diagnosis))
            )
        ):
            break
        diagnosis = growing.diagnosed()
    else:
        if growing.prune():
            diagnosis = growing.diagnosed()
    if take_out_noise(growing):
        diagnosis = growing.diagnosed()
    kept = set(growing.steps[-1].result.model.effects)
    refused = tuple(e for e in growing.refused if e not in kept)
    spoiling = tuple(s for s in growing.spoiling.values() if not kept.issuperset(s))
    named = {e for s in spoiling for e in s}
    refused = tuple(e for e in refused if e not in named)
    why = {e.spec: growing.why.get(e.spec, NO_BETTER) for e in refused}
    return Course(tuple(growing.steps), refused, diagnosis, spoiling, why)


def _add_another(growing: GrowingModel, diagnosis: Diagnosis) -> bool:
    """Add what was ranked behind the causes that stood, and of which none was taken.

    Causes that were chosen together may imitate a plainer one that none of them is.
    """
    if not diagnosis.established:
        return False
    n = diagnosis.basis.n
    behind = [f.candidate.effect for f in diagnosis.ranked if f.established(n)]
    others = [e for e in behind if e.scope != "instrument" and not e.of_the_clock]
    return any(growing.add(effect) for effect in others[:MOST_TRIED])


def _complete_motions(growing: GrowingModel, diagnosis: Diagnosis) -> bool:
    """Add another error motion of an axis of which some are added and more is left.

    Every axis has all of its motions. Where some of them are established and structure is
    left, all of them together, else another one, come before any description of it: if the data
    speak for it at all, and left-out blocks are predicted better by what is worth a cause. In more
    detail what is there as well, unless a wave of its axis says more: a table of every crest
    foretells the wave only where it was measured.
    """
    if diagnosis.verdict != "unexplained":
        return False
    known = {getattr(e, "axis", "") for e in growing.added if e.kind in RIGID}
    if known and whole_body(growing, diagnosis, axes=0):
        return True
    there = {motion(e) for e in growing.last.result.model.effects}
    waves: set[object] = set()
    for found in diagnosis.ranked[:MOST_TRIED]:
        effect = found.candidate.effect
        axis = getattr(effect, "axis", None)
        if effect.kind == "cyclic":
            waves.add(axis)
        finer = motion(effect) in there
        rest = effect.kind in RIGID and axis in known and not (finer and axis in waves)
        if rest and found.evidence.value > 0.0 and growing.add(effect, falls=1.0 - WORTH):
            return True
    return False


def _complete_joints(growing: GrowingModel, diagnosis: Diagnosis) -> bool:
    """Add where the other joints of a chain lie, and how those that sag weigh on each other.

    Every joint of an arm or a head lies a little elsewhere than it was drawn. Where that of one
    is established, those of the others are worth little one by one, each less than a cause
    has to be worth, and together they may be worth one.
    """
    if not any(e.kind == "rotary_location" for e in growing.added):
        return False
    ranked = [f.candidate.effect for f in diagnosis.ranked]
    places = [e for e in ranked if e.kind in ("rotary_location", "spindle_location")]
    hanging = {e.axis for e in growing.added if isinstance(e, GravityFlexure)}
    weights = [e for e in ranked if isinstance(e, GravityFlexure) and {e.axis, e.by} <= hanging]
    for effects in ((*places, *weights), tuple(places)) if weights else (tuple(places),):
        if len(effects) > 1 and growing.add_once_together(effects, 1.0 - WORTH):
            return True
    return False


def _motions_first(effects: Sequence[Effect]) -> list[Effect]:
    """Effects without waves and dents along an axis whose error motion is yet to be added.

    What they show may be only what the motion's first shape is too coarse for, so its detail is
    asked first.
    """
    moving = {getattr(e, "axis", None) for e in effects if e.kind in RIGID}
    return [
        e for e in effects if e.kind not in ALONG_AN_AXIS or getattr(e, "axis", "") not in moving
    ]
