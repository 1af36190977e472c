"""From a machine and a campaign to a model: diagnose, add, look again, until the verdict.

Every step is one effect more, fitted together with all others, and is kept only if blocks of the
campaign that are left out of the fit (set-ups, stretches of time, places) are predicted better with
it. At the end each effect that was added is tried without: what later ones made superfluous goes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.diagnosis.findings import measured_kinds
from abbe.compcore.diagnosis.foretelling import OF_THE_CLOCK, WORTH
from abbe.compcore.diagnosis.regression import regression
from abbe.compcore.diagnosis.screening.candidates import RIGID
from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.soundness import apart, sound, worth
from abbe.compcore.diagnosis.strays import Stray
from abbe.compcore.diagnosis.thermometers import (
    further_thermometers,
    jointly,
    of_temperatures,
    warmth_together,
)
from abbe.compcore.diagnosis.uncatalogued.chosen import (
    Grown,
    best_beside,
    best_instead,
    grown,
    of_positions_alone,
)
from abbe.compcore.diagnosis.uncatalogued.descriptions import LEAST
from abbe.compcore.diagnosis.verdict import Diagnosis, lacking
from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.catalogue.temperature.lengths import ThermalOffset
from abbe.compcore.effects.signals import LaggedEffect
from abbe.compcore.errors import FitError
from abbe.compcore.fitting.design.begun import begun
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect, without_effect

Progress = Callable[[str], None]

MOST_STEPS = 40
"""A model that needs more effects is looked at by its user first."""

ALONG_AN_AXIS = ("cyclic", "local_defect")
"""Causes that are a function of one linear axis's position, as an error motion of any detail is."""

_NEXT = 6
"""So many of the leading candidates are tried where none of those established is taken."""

_FALLS = 0.998
"""Part of the left-out χ² below which an addition's or a lag's has fallen."""


@dataclass(frozen=True, eq=False)
class Step:
    """One change of the model.

    Attributes
    ----------
    action
        ``began``, ``added``, ``added together`` (with the next, as neither predicts anything
        alone), ``lagged`` (its signals stand behind a lag now), ``second body`` (behind the same
        signal), ``began elsewhere`` (than in equilibrium with its signal), ``described`` (by what
        explains nothing), ``removed``, ``set aside`` (readings that stand alone).
    effect
        The effect that was added, changed or taken out; None for the beginning and for readings.
    result
        The fit with it.
    held_out
        How left-out blocks are predicted.
    strays
        The readings that were set aside.
    """

    action: str
    effect: Effect | None
    result: FitResult
    held_out: LeftOutErrors
    strays: tuple[Stray, ...] = ()

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """What its error is stated in: lengths, or rotations where there is nothing else."""
        return measured_kinds(self.result)

    @property
    def of_rotations(self) -> bool:
        """Whether its error is stated as rotations."""
        return self.kinds == (Kind.ROTATION,)


@dataclass(frozen=True, eq=False)
class Course:
    """All steps from a model to the verdict.

    Attributes
    ----------
    steps
        The first is the model as it was given, fitted.
    refused
        Effects that a diagnosis proposed and that predict left-out blocks no better.
    diagnosis
        Of the last model.
    """

    steps: tuple[Step, ...]
    refused: tuple[Effect, ...]
    diagnosis: Diagnosis

    @property
    def last(self) -> Step:
        """The model that was reached."""
        return self.steps[-1]


def to_the_verdict(
    model: Model,
    campaign: Campaign,
    *,
    on_step: Callable[[Step], None] = lambda _: None,
    progress: Progress = lambda _: None,
) -> Course:
    """Add what the diagnosis establishes until it establishes nothing more.

    Parameters
    ----------
    model
        Where to begin; it may have no effects at all.
    campaign
        The measurements.
    on_step
        Called with every step as soon as it is made.
    progress
        Called with a few words at the start of each stage.

    Raises
    ------
    FitError
        As `diagnose`.
    """
    course = _StepwiseCourse(model, campaign, on_step, progress)
    diagnosis = course.diagnosed()
    while len(course.steps) < MOST_STEPS:
        found = [e.found.candidate.effect for e in diagnosis.established]
        new = _motions_first([e for e in found if not course.refused_now(e)])
        read = [e for e in new if e.kind not in OF_THE_CLOCK]
        clock = [e for e in new if read and e.kind in OF_THE_CLOCK]
        if new and not read and course.bodies():
            diagnosis = course.diagnosed()
            continue
        if (
            course.add_all(read or new)
            or course.add_another(diagnosis)
            # what reads a signal was taken by none of the blocks: what reads the clock is no worse
            or course.add_all(clock)
        ):
            course.lag()
        elif not (
            course.detail(diagnosis)
            or course.sharpen(diagnosis)
            or course.complete_motions(diagnosis)
            or course.prune()
            or course.regress(diagnosis)
            or course.describe(diagnosis)
        ):
            break
        diagnosis = course.diagnosed()
    else:
        if course.prune():
            diagnosis = course.diagnosed()
    kept = set(course.steps[-1].result.model.effects)
    refused = tuple(e for e in course.refused if e not in kept)
    return Course(tuple(course.steps), refused, diagnosis)


class _StepwiseCourse:
    """The model as far as it is, and how it came there."""

    def __init__(
        self,
        model: Model,
        campaign: Campaign,
        on_step: Callable[[Step], None],
        progress: Progress,
    ) -> None:
        self._campaign = campaign
        self._on_step, self._progress = on_step, progress
        self.refused: dict[Effect, int] = {}
        self.steps: list[Step] = []
        self._added: list[Effect] = []
        self._strays: list[Stray] = []
        self._regressed = -1
        result = fit(model, campaign)
        self._make("began", None, result, LeftOutErrors.of(result))

    @property
    def _last(self) -> Step:
        return self.steps[-1]

    def _make(
        self, action: str, effect: Effect | None, result: FitResult, out: LeftOutErrors
    ) -> None:
        self.steps.append(Step(action, effect, result, out))
        self._on_step(self._last)

    def diagnosed(self) -> Diagnosis:
        """What the model lacks as it is now; readings that stand alone count no more."""
        found = lacking(self._last.result, progress=self._progress)
        if found.strays:
            self._strays += found.strays
            self._campaign = found.whole.problem.campaign
            out = LeftOutErrors.of(found.whole)
            self.steps.append(Step("set aside", None, found.whole, out, found.strays))
            self._on_step(self._last)
        return replace(found, strays=tuple(self._strays))

    def refused_now(self, effect: Effect) -> bool:
        """Whether an effect was refused beside the model as it is now; beside another it may do."""
        return self.refused.get(effect) == len(self.steps)

    def add_all(self, effects: Sequence[Effect]) -> bool:
        """Add those with which left-out blocks are predicted better, however they are ordered.

        Each by itself; and those that one by one predict nothing together, as they were found: of
        two thermometers that read nearly the same the difference may say what neither says.
        """
        before = len(self.steps)
        left = list(effects)
        while left:
            waiting = [e for e in left if not self.add(e)]
            if len(waiting) == len(left):
                while len(waiting) > 1 and not self._add_together(waiting):
                    del waiting[-1]
                break
            left = waiting
        return len(self.steps) > before

    def add(self, effect: Effect, *, falls: float = _FALLS) -> bool:
        """Add an effect if left-out blocks are predicted better with it, χ² falling to a part."""
        if self.refused_now(effect):
            return False
        self._progress(f"adding {effect.kind}")
        before = self._last.result.model
        more, added = with_effect(before, effect.kind, effect.where())
        if not self._try("added", added, more, falls):
            self.refused[effect] = len(self.steps)
            return False
        self._adopt(more, added)
        return True

    def add_another(self, diagnosis: Diagnosis) -> bool:
        """Add what was ranked behind the causes that stood, and of which none was taken.

        Causes that were chosen together may imitate a plainer one that none of them is.
        """
        if not diagnosis.established:
            return False
        n = diagnosis.basis.n
        behind = [f.candidate.effect for f in diagnosis.ranked if f.established(n)]
        others = [e for e in behind if e.scope != "instrument" and e.kind not in OF_THE_CLOCK]
        return any(self.add(effect) for effect in others[:_NEXT])

    def complete_motions(self, diagnosis: Diagnosis) -> bool:
        """Add another error motion of an axis of which some are added and more is left.

        Every axis has all of its motions. Where some of them are established and structure is
        left, another one comes before any description of it: if the data speak for it at all, and
        left-out blocks are predicted better by what is worth a cause.
        """
        if diagnosis.verdict != "unexplained":
            return False
        known = {getattr(e, "axis", "") for e in self._added if e.kind in RIGID}
        for found in diagnosis.ranked[:_NEXT]:
            effect = found.candidate.effect
            rest = effect.kind in RIGID and getattr(effect, "axis", None) in known
            if rest and found.evidence.value > 0.0 and self.add(effect, falls=1.0 - WORTH):
                return True
        return False

    def sharpen(self, diagnosis: Diagnosis) -> bool:
        """Add further thermometers where warmth is established and they predict better."""
        warm = [e for e in self._added if e in self._last.result.model.effects]
        further = further_thermometers(diagnosis, warm)
        if not further and diagnosis.verdict == "unexplained":
            further = warmth_together(diagnosis)
        for effects in further[:_NEXT]:
            if len(effects) == 1:
                if self.add(effects[0]):
                    return True
            elif self._add_together(effects):
                return True
        return False

    def regress(self, diagnosis: Diagnosis) -> bool:
        """Take the thermometers by which a linear regression foretells surely better.

        Beside what is there, or in place of the warmth that was found.
        """
        self._progress("thermometers together")
        effects = jointly(diagnosis)
        if effects and self._add_together(effects, 1.0 - LEAST):
            return True
        before = self._last.result
        warm = [e for e in self._added if of_temperatures(e, before.model.machine)]
        if not warm or self._regressed == len(self.steps) or _described(self._added):
            return False
        self._regressed = len(self.steps)
        less = before.model
        for effect in warm:
            less, _ = without_effect(less, effect.spec)
        instead = regression(fit(less, self._campaign, near=True))
        if not instead:
            return False
        more = grown(less, instead)
        found = self._better(more[-1][0], [one for _, one in more], 1.0 - LEAST)
        if found is None:
            return False
        for effect in warm:
            fewer, _ = without_effect(self._last.result.model, effect.spec)
            result = fit(fewer, self._campaign, near=True)
            self._make("removed", effect, result, LeftOutErrors.of(result))
            self._added.remove(effect)
        self._make_together("added together", "added", more, *found)
        return True

    def _add_together(self, effects: Sequence[Effect], falls: float = _FALLS) -> bool:
        """Add several effects if with all of them left-out blocks are predicted better."""
        self._progress(f"adding {len(effects)} effects together")
        more = grown(self._last.result.model, effects)
        found = self._better(more[-1][0], [one for _, one in more], falls)
        if found is None:
            return False
        self._make_together("added together", "added", more, *found)
        return True

    def _make_together(
        self, before: str, last: str, more: Grown, result: FitResult, out: LeftOutErrors
    ) -> None:
        """Steps of effects that belong together: the first ones fitted as they come, then all."""
        for model, one in more[:-1]:
            partly = fit(model, self._campaign, near=True)
            self._make(before, one, partly, LeftOutErrors.of(partly))
        self._make(last, more[-1][1], result, out)
        for model, one in more:
            self._adopt(model, one)

    def _adopt(self, model: Model, added: Effect) -> None:
        """Count an effect among those that were added."""
        kept = set(model.effects)
        self._added = [e for e in self._added if e in kept] + [added]

    def detail(self, diagnosis: Diagnosis) -> bool:
        """More detail in what is there, where structure is left that no further cause explains.

        What was refused while causes were still missing is tried once more.
        """
        if diagnosis.verdict == "complete":
            return False
        before = len(self.steps)
        self.lag(again=True)
        return self.bodies(again=True) or len(self.steps) > before

    def lag(self, *, again: bool = False) -> None:
        """Put signals of effects that were added behind a lag, where that predicts better.

        `again`: also where it was refused beside another model than now.
        """
        for effect in list(self._added):
            if not isinstance(effect, LaggedEffect) or effect.tau is not None:
                continue
            self._progress(f"a lag for {effect.kind}")
            lagged = self._detailed("lagged", effect, {"tau": "fit"}, again=again)
            if not lagged and isinstance(effect, ThermalOffset):
                # a lag may be hidden by a body that began elsewhere
                elsewhere = {"tau": "fit", "start": "fit"}
                self._detailed("began elsewhere", effect, elsewhere, again=again)

    def bodies(self, *, again: bool = False) -> bool:
        """A second body behind a lagged signal, or one that began elsewhere than in equilibrium.

        `again`: also where it was refused beside another model than now.
        """
        before = len(self.steps)
        for key, action in (("start", "began elsewhere"), ("tau2", "second body")):
            for effect in list(self._added):
                lagged = isinstance(effect, ThermalOffset) and effect.tau == "fit"
                if lagged and getattr(effect, key) is None:
                    self._progress(f"{effect.kind}: {action}")
                    self._detailed(action, effect, {key: "fit"}, again=again)
        return len(self.steps) > before

    def _detailed(
        self, action: str, effect: Effect, detail: dict[str, str], *, again: bool
    ) -> bool:
        """Exchange an effect for one of more detail, where that predicts better."""
        fuller = effect.model_copy(update=detail)
        if self.refused_now(fuller) or (fuller in self.refused and not again):
            return False
        before = self._last.result.model
        more, _ = with_effect(before, fuller.kind, fuller.where())
        found = self._better(more, (fuller,), _FALLS)
        if found is None or not worth(self._last.result, found[0]):
            self.refused[fuller] = len(self.steps)
            return False
        self._make(action, fuller, *found)
        self._added[self._added.index(effect)] = fuller
        return True

    def describe(self, diagnosis: Diagnosis) -> bool:
        """Describe what no cause explains, where that foretells left-out blocks surely better.

        Of all descriptions the one that foretells best: beside the causes; or over the whole volume
        in place of the error motions that were added, where they foretell surely worse.
        """
        self._progress("describing what no cause explains")
        before = self._last.result
        motions = [e for e in self._added if of_positions_alone(e, before.model.machine)]
        if motions and not _described(before.model.effects):
            less = before.model
            for effect in motions:
                less, _ = without_effect(less, effect.spec)
            instead = best_instead(before, less, self._campaign, self.refused_now)
            if instead is not None:
                self._replace(motions, instead)
                return True
        found = best_beside(before, self._campaign, diagnosis, self.refused_now)
        if found is None:
            return False
        more, result = found
        self._make_together("described", "described", more, result, LeftOutErrors.of(result))
        return True

    def _replace(self, motions: Sequence[Effect], effects: Sequence[Effect]) -> None:
        """Describe, then take out error motions that were added before."""
        more = grown(self._last.result.model, effects)
        result = fit(more[-1][0], self._campaign, near=True)
        self._make_together("described", "described", more, result, LeftOutErrors.of(result))
        for effect in motions:
            less, _ = without_effect(self._last.result.model, effect.spec)
            result = fit(less, self._campaign, near=True)
            self._make("removed", effect, result, LeftOutErrors.of(result))
            self._added.remove(effect)

    def prune(self) -> bool:
        """Take out what was added and is superfluous by now.

        A formula names no cause: beside one none goes for saying the same.
        """
        if _described(self._added):
            return False
        before = len(self._added)
        for effect in list(self._added):
            self._progress(f"without {effect.kind}")
            less, _ = without_effect(self._last.result.model, effect.spec)
            if self._try("removed", effect, less, 1.0):
                self._added.remove(effect)
        return len(self._added) < before

    def _try(self, action: str, effect: Effect, model: Model, falls: float) -> bool:
        found = self._better(model, (effect,), falls)
        if found is not None:
            self._make(action, effect, *found)
        return found is not None

    def _better(
        self, model: Model, changed: Sequence[Effect], falls: float
    ) -> tuple[FitResult, LeftOutErrors] | None:
        """A model's fit, and how it predicts, if left-out χ² falls to a part; else None."""
        try:
            result = fit(model, self._campaign, near=True)
        except FitError:
            return None
        bound = all(e.scope == "instrument" for e in changed)
        before = LeftOutErrors.of(self._last.result, changed)
        after = LeftOutErrors.of(result, changed)
        if before.falls_to(after, result, bound=bound) > falls:
            return None
        if not all(apart(result.model, e) for e in changed):
            return None
        if not all(b.plausible for b in begun(result.problem, result.theta)):
            return None  # a body that began where none can have been is no body
        if not all(sound(result.model, e) for e in changed):
            return None
        return result, LeftOutErrors.of(result)


def _described(effects: Sequence[Effect]) -> bool:
    """Whether there is a formula among effects: it names no cause."""
    return any(e.kind == "formula" for e in effects)


def _motions_first(effects: Sequence[Effect]) -> list[Effect]:
    """Effects without waves and dents along an axis whose error motion is yet to be added.

    What they show may be only what the motion's first shape is too coarse for, so its detail is
    asked first.
    """
    moving = {getattr(e, "axis", None) for e in effects if e.kind in RIGID}
    return [
        e for e in effects if e.kind not in ALONG_AN_AXIS or getattr(e, "axis", "") not in moving
    ]
