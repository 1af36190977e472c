"""From a machine and a campaign to a model: diagnose, add, look again, until the verdict.

Every step is one effect more, fitted together with all others, and is kept only if blocks of the
campaign that are left out of the fit (set-ups, stretches of time, places) are predicted better with
it. At the end each effect that was added is tried without: what later ones made superfluous goes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from abbe.compcore.campaign.campaign import LENGTHS, Campaign, Kind
from abbe.compcore.diagnosis.findings import measured_kinds
from abbe.compcore.diagnosis.screening.crossvalidation import LeftOut, folds
from abbe.compcore.diagnosis.screening.screening import Basis
from abbe.compcore.diagnosis.verdict import Diagnosis, diagnose
from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.catalogue.temperature.lengths import ThermalOffset
from abbe.compcore.effects.signals import LaggedEffect
from abbe.compcore.errors import FitError
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.linalg import threads_for
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect, without_effect

Progress = Callable[[str], None]

MOST_STEPS = 40
"""A model that needs more effects is looked at by its user first."""

OF_THE_CLOCK = ("warm_up", "drift", "event")
"""Causes that read no signal: what follows a recorded one is looked for in all detail before."""

_TWO = 2.0
"""Least ratio of two time constants behind one signal."""

_FALLS = 0.998
"""Part of the left-out χ² below which an addition's or a lag's has fallen."""


@dataclass(frozen=True, eq=False)
class LeftOutErrors:
    """How a fit predicts the blocks of its campaign that were left out, each in its turn.

    Attributes
    ----------
    left
        What the fit without each block leaves of it, in mm or rad.
    lengths, rotations
        Root mean squares, mm and rad; NaN without such rows.
    """

    left: LeftOut
    lengths: float
    rotations: float

    @classmethod
    def of(cls, result: FitResult) -> LeftOutErrors:
        """Leave out every block of a fit; exact for what is linear, non-linear values kept."""
        thin = result.thin
        campaign = thin.problem.campaign
        with threads_for(thin.problem.n * thin.problem.layout.size):
            left = LeftOut.of(Basis.of(thin), folds(campaign.conditions))
        used = thin.problem.weight > 0.0
        sd = np.where(used, thin.problem.sd, 0.0)
        left = replace(left, residual=left.residual * sd)

        def rms(*kinds: Kind) -> float:
            rows = np.isin(campaign.kind, kinds) & used
            return float(np.sqrt(np.mean(left.residual[rows] ** 2))) if rows.any() else math.nan

        return cls(left, rms(*LENGTHS), rms(Kind.ROTATION))

    def falls_to(self, fuller: LeftOutErrors, result: FitResult, *, bound: bool) -> float:
        """The part of the left-out χ² that another fit to the same rows leaves.

        Parameters
        ----------
        fuller
            How the other fit predicts.
        result
            That fit, in the uncertainties of which both are judged.
        bound
            Whether what was added belongs to the placing of an instrument (`gain`).
        """
        weight = result.thin.problem.weight
        after = fuller.left.residual if bound else self.left.with_what_it_foretells(fuller.left)
        before = float(np.sum((self.left.residual * weight) ** 2))
        return float(np.sum((after * weight) ** 2)) / before if before > 0.0 else 1.0


@dataclass(frozen=True, eq=False)
class Step:
    """One change of the model.

    Attributes
    ----------
    action
        ``began``, ``added``, ``lagged`` (its signals stand behind a lag now), ``second body``
        (behind the same signal), ``began elsewhere`` (than in equilibrium with its signal),
        ``removed``.
    effect
        The effect that was added, changed or taken out; None for the beginning.
    result
        The fit with it.
    held_out
        How left-out blocks are predicted.
    """

    action: str
    effect: Effect | None
    result: FitResult
    held_out: LeftOutErrors

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """What its error is told of: lengths, or rotations where the campaign has nothing else."""
        return measured_kinds(self.result)

    @property
    def of_rotations(self) -> bool:
        """Whether its error is told of rotations."""
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
    course = _Course(model, campaign, on_step, progress)
    diagnosis = course.diagnosed()
    while len(course.steps) < MOST_STEPS:
        found = [e.found.candidate.effect for e in diagnosis.established]
        new = [e for e in found if e not in course.refused]
        read = [e for e in new if e.kind not in OF_THE_CLOCK]
        if new and not read and course.bodies():
            diagnosis = course.diagnosed()
            continue
        taken = [course.add(effect) for effect in read or new]
        if any(taken):
            course.lag()
        elif diagnosis.verdict == "complete" or not course.bodies():
            break
        diagnosis = course.diagnosed()
    if course.prune():
        diagnosis = course.diagnosed()
    return Course(tuple(course.steps), tuple(course.refused), diagnosis)


class _Course:
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
        self.refused: list[Effect] = []
        self.steps: list[Step] = []
        self._added: list[Effect] = []
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
        """What the model lacks as it is now."""
        return diagnose(self._last.result.model, self._campaign, progress=self._progress)

    def add(self, effect: Effect) -> bool:
        """Add an effect if left-out blocks are predicted better with it."""
        self._progress(f"adding {effect.kind}")
        before = self._last.result.model
        more, added = with_effect(before, effect.kind, effect.where())
        if not self._try("added", added, more, _FALLS):
            self.refused.append(effect)
            return False
        kept = set(more.effects)
        self._added = [e for e in self._added if e in kept] + [added]
        return True

    def lag(self) -> None:
        """Put signals of effects that were added behind a lag, where that predicts better."""
        for effect in list(self._added):
            if not isinstance(effect, LaggedEffect) or effect.tau is not None:
                continue
            self._progress(f"a lag for {effect.kind}")
            if not self._detailed("lagged", effect, {"tau": "fit"}) and isinstance(
                effect, ThermalOffset
            ):
                # a lag may be hidden by a body that began elsewhere
                self._detailed("began elsewhere", effect, {"tau": "fit", "start": "fit"})

    def bodies(self) -> bool:
        """A second body behind a lagged signal, or one that began elsewhere than in equilibrium."""
        before = len(self.steps)
        for key, action in (("start", "began elsewhere"), ("tau2", "second body")):
            for effect in list(self._added):
                lagged = isinstance(effect, ThermalOffset) and effect.tau == "fit"
                if lagged and getattr(effect, key) is None:
                    self._progress(f"{effect.kind}: {action}")
                    self._detailed(action, effect, {key: "fit"})
        return len(self.steps) > before

    def _detailed(self, action: str, effect: Effect, detail: dict[str, str]) -> bool:
        """Exchange an effect for one of more detail, where that predicts better."""
        fuller = effect.model_copy(update=detail)
        if fuller in self.refused:
            return False
        more, _ = with_effect(self._last.result.model, fuller.kind, fuller.where())
        if not self._try(action, fuller, more, _FALLS):
            self.refused.append(fuller)
            return False
        self._added[self._added.index(effect)] = fuller
        return True

    def prune(self) -> bool:
        """Take out what was added and is superfluous by now."""
        removed = False
        for effect in self._added[:-1]:
            self._progress(f"without {effect.kind}")
            less, _ = without_effect(self._last.result.model, effect.spec)
            removed |= self._try("removed", effect, less, 1.0)
        return removed

    def _try(self, action: str, effect: Effect, model: Model, falls: float) -> bool:
        try:
            result = fit(model, self._campaign)
        except FitError:
            return False
        out = LeftOutErrors.of(result)
        bound = effect.scope == "instrument"
        if self._last.held_out.falls_to(out, result, bound=bound) > falls:
            return False
        if not _apart(result.model, effect):
            return False
        self._make(action, effect, result, out)
        return True


def _apart(model: Model, effect: Effect) -> bool:
    """Whether the time constants of two bodies behind one signal are two.

    Of nearly the same two lags the difference is a derivative: it follows noise, and foretells
    nothing.
    """
    values = next((t.values for t in model.terms if t.effect == effect), {})
    if "tau2" not in values or "tau" not in values:
        return True
    one, other = (values[name].value for name in ("tau", "tau2"))
    return max(one, other) > _TWO * min(one, other)
