"""A model that grows: an effect is taken only if left-out blocks are predicted better with it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis.judging.at_rest import beyond_what_was_seen
from abbe.compcore.diagnosis.judging.second_order import beyond_first_order
from abbe.compcore.diagnosis.judging.soundness import (
    absurd,
    apart,
    by_another_thermometer,
    comes,
    sound,
)
from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.stepwise.step import Step
from abbe.compcore.diagnosis.stepwise.unseen import UnseenCampaign
from abbe.compcore.diagnosis.strays import Stray
from abbe.compcore.diagnosis.uncatalogued.chosen import Grown, grown
from abbe.compcore.diagnosis.verdict import Diagnosis, lacking
from abbe.compcore.effects.base import Effect
from abbe.compcore.errors import FitError
from abbe.compcore.fitting.cancelling import cancelling
from abbe.compcore.fitting.cautious import cautiously
from abbe.compcore.fitting.design.begun import begun
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import identity, with_effect, without_effect

Progress = Callable[[str], None]

NO_WORSE = 1.0 + 1e-9
"""Part of the left-out χ² up to which nothing is lost; what others can say rounds to a little more
than 1 or a little less, as the processor has it."""
NO_BETTER = "left-out blocks are not predicted better with it"
FALLS = 0.998
"""Part of the left-out χ² below which an addition's or a lag's has fallen."""

BY_ANOTHER_BODY = 0.8
"""The same where a scale is to expand by another body's thermometer too: it averages its noise."""


class GrowingModel:
    """The model as far as it is, and how it came there.

    Attributes
    ----------
    campaign
        The measurements, without those that were set aside.
    progress
        Called with a few words at the start of each stage.
    steps
        Every change so far; the first is the model as it was given, fitted.
    added
        The effects that were added and are still there.
    described
        Those of the added that no cause was named by: a curve or a formula that foretells.
    refused
        Effect → after how many steps it was refused.
    why
        Spec of what was refused → why, in words that follow *not kept,*.
    superfluous
        What was taken out again, by its spec, and the specs of the effects beside which it was.
    regressed
        After how many steps a regression on all thermometers was last asked; −1: never.
    together
        The sets of effects that `add_once_together` asked.
    bodies, of_bodies
        Whether all error motions of the axes may be added at once, and those that were.
    instruments
        How many effects of instruments there were when the scales' expansions were last asked.
    spoiling
        What fitted blocks asked for and the held-out campaign refused, by its specs.
    """

    def __init__(
        self,
        model: Model,
        campaign: Campaign,
        on_step: Callable[[Step], None],
        progress: Progress,
        unseen: UnseenCampaign | None = None,
        *,
        bodies: bool = True,
    ) -> None:
        self.campaign = campaign
        self.bodies, self.instruments = bodies, 0
        self.of_bodies: Sequence[Effect] = ()
        self._unseen = unseen
        self.spoiling: dict[tuple[str, ...], tuple[Effect, ...]] = {}
        self._on_step, self.progress = on_step, progress
        self.refused: dict[Effect, int] = {}
        self.why: dict[str, str] = {}
        self.superfluous: dict[str, frozenset[str]] = {}
        self.steps: list[Step] = []
        self.added: list[Effect] = []
        self.described: list[Effect] = []
        self._strays: list[Stray] = []
        self.regressed = -1
        self.together: set[frozenset[str]] = set()
        result = fit(model, campaign)
        self.make("began", None, result, LeftOutErrors.of(result))

    @property
    def last(self) -> Step:
        """The model as it is now."""
        return self.steps[-1]

    def make(
        self, action: str, effect: Effect | None, result: FitResult, out: LeftOutErrors
    ) -> None:
        """Make a step, and tell of it."""
        self.steps.append(Step(action, effect, result, out))
        self._on_step(self.last)

    def diagnosed(self) -> Diagnosis:
        """What the model lacks as it is now; readings that stand alone count no more.

        Where angles are so large that errors no longer add up they are composed in full from now
        on, if the campaign says so.
        """
        self._compose()
        found = lacking(self.last.result, progress=self.progress)
        if found.strays:
            self._strays += found.strays
            self.campaign = found.whole.problem.campaign
            out = LeftOutErrors.of(found.whole)
            self.steps.append(Step("set aside", None, found.whole, out, found.strays))
            self._on_step(self.last)
        return replace(found, strays=tuple(self._strays))

    def _compose(self) -> None:
        now = self.last.result
        if not beyond_first_order(now.thin, now.chi2 / max(1, now.dof)) or cancelling(now)[1]:
            return  # angles that are large only against each other are no machine's
        full = fit(replace(now.model, composition="exact"), self.campaign, near=True)
        if full.chi2_beside(now) < now.chi2 and not cancelling(full)[1]:
            self.make("composed", None, full, LeftOutErrors.of(full))

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
                while len(waiting) > 1 and not self.add_together(waiting):
                    del waiting[-1]
                break
            left = waiting
        return len(self.steps) > before

    def add(self, effect: Effect, *, falls: float = FALLS) -> bool:
        """Add an effect if left-out blocks are predicted better with it, χ² falling to a part."""
        if self.refused_now(effect):
            return False
        self.progress(f"adding {effect.kind}")
        before = self.last.result.model
        more, added = with_effect(before, effect.kind, effect.where())
        if self.superfluous.get(added.spec) == _specs(before):
            return False  # it would be taken out and come back for ever
        if not self._try("added", added, more, falls):
            self.refused[effect] = len(self.steps)
            return False
        self.adopt(more, added)
        return True

    def add_together(self, effects: Sequence[Effect], falls: float = FALLS) -> bool:
        """Add several effects if with all of them left-out blocks are predicted better."""
        self.progress(f"adding {len(effects)} effects together")
        more = grown(self.last.result.model, effects)
        found = self.better(more[-1][0], [one for _, one in more], falls)
        if found is None:
            return False
        self.make_together("added together", "added", more, *found)
        return True

    def add_once_together(self, effects: Sequence[Effect], falls: float) -> bool:
        """As `add_together`; a set that was asked before is not asked again.

        Taken out since, as the others say it too, it would come back for ever.
        """
        return self.once(effects) and self.add_together(effects, falls)

    def once(self, effects: Sequence[Effect]) -> bool:
        """Whether a set of effects is asked for the first time."""
        specs = frozenset(e.spec for e in effects)
        asked = specs in self.together
        self.together.add(specs)
        return not asked

    def make_together(
        self, before: str, last: str, more: Grown, result: FitResult, out: LeftOutErrors
    ) -> None:
        """Steps of effects that belong together: the first ones fitted as they come, then all."""
        for model, one in more[:-1]:
            partly = fit(model, self.campaign, near=True)
            self.make(before, one, partly, LeftOutErrors.of(partly))
        self.make(last, more[-1][1], result, out)
        for model, one in more:
            self.adopt(model, one)
            if last == "described":
                self.described.append(one)

    def adopt(self, model: Model, added: Effect) -> None:
        """Count an effect among those that were added."""
        kept = set(model.effects)
        self.added = [e for e in self.added if e in kept] + [added]

    def take_out(self, effects: Sequence[Effect]) -> None:
        """Take out effects that were added, each a step, whatever left-out blocks say of it."""
        for effect in effects:
            less, _ = without_effect(self.last.result.model, effect.spec)
            result = fit(less, self.campaign, near=True)
            self.make("removed", effect, result, LeftOutErrors.of(result))
            self.added.remove(effect)

    def prune(self) -> bool:
        """Take out what was added and is superfluous by now.

        A formula names no cause: beside one none goes for saying the same. What was described
        stays: the blocks that it was judged by are others. So do the error motions that were added
        all at once: every axis has them.
        """
        if described(self.added):
            return False
        out: list[Effect] = []
        bodies = {identity(e) for e in self.of_bodies}
        for effect in [e for e in self.added if e not in self.described]:
            if identity(effect) in bodies:
                continue
            self.progress(f"without {effect.kind}")
            less = self._plainer(effect)
            if self._try("removed", effect, less, NO_WORSE):
                self.added.remove(effect)
                out.append(effect)
        beside = _specs(self.last.result.model)
        self.superfluous |= {e.spec: beside for e in out}
        return bool(out)

    def _plainer(self, effect: Effect) -> Model:
        """The model without an effect that was added; in the detail in which it was given."""
        given = self.steps[0].result.model.effects
        plain = next((e for e in given if identity(e) == identity(effect)), None)
        now = self.last.result.model
        if plain is None or plain == effect:
            return without_effect(now, effect.spec)[0]
        return with_effect(now, plain.kind, plain.where())[0]

    def _try(self, action: str, effect: Effect, model: Model, falls: float) -> bool:
        found = self.better(model, (effect,), falls)
        if found is not None:
            self.make(action, effect, *found)
        return found is not None

    def spoils(self, result: FitResult, changed: Sequence[Effect]) -> bool:
        """Whether the held-out campaign is predicted worse with a change; it is kept that it is."""
        if self._unseen is None or not self._unseen.spoilt(self.last.result.model, result.model):
            return False
        self.spoiling[tuple(e.spec for e in changed)] = tuple(changed)
        return True

    def _unsound(self, result: FitResult, changed: Sequence[Effect]) -> str:
        """Why a change is none that a machine or a thermometer makes; empty where it may be."""
        model = result.model
        if not all(apart(model, e) for e in changed):
            return "what it would say twice, two bodies or two waves, is one"
        if not all(b.plausible for b in begun(result.problem, result.theta)):
            return "its body would have begun where none can have been"
        if not all(sound(model, e) for e in changed):
            return "its value is beyond what is believable, or its lag was not measured"
        if self.goes_late(result, changed):
            return "a body would lag by more than the campaign lasted"
        if any(beyond_what_was_seen(result, e) for e in changed):
            return "were its signal to stay, it would say ten times all that was measured"
        known = {e for e in self.last.result.model.effects if absurd(self.last.result.model, e)}
        if any(absurd(model, e) for e in model.effects if e not in known):
            return "with it an effect would err beyond all that machines do"
        return ""

    def goes_late(self, result: FitResult, changed: Sequence[Effect] = ()) -> bool:
        """Whether an effect, or a changed one, lags by more in a fit than the campaign lasted."""
        late = [e for e in result.model.effects if not comes(result, e)]
        return any(e in changed or comes(self.last.result, e) for e in late)

    def better(
        self, model: Model, changed: Sequence[Effect], falls: float, *, cautious: bool = False
    ) -> tuple[FitResult, LeftOutErrors] | None:
        """A model's fit, and how it predicts, if left-out χ² falls to a part; else None.

        None as well where the held-out campaign is predicted worse. With `cautious`, left-out
        blocks are predicted by values that are held near 0 where the others do not show them.
        """
        try:
            result = fit(model, self.campaign, near=True)
        except FitError:
            return None
        bound = all(e.scope == "instrument" for e in changed)
        if any(e in model.effects and by_another_thermometer(model, e) for e in changed):
            falls = min(falls, BY_ANOTHER_BODY)
        judged = cautiously(result) if cautious else result
        before, after = LeftOutErrors.beside(self.last.result, judged, changed)
        why = NO_BETTER
        if before.falls_to(after, result, bound=bound) <= falls:
            why = self._unsound(result, changed)
        if why:
            self.why |= {e.spec: why for e in changed}
            return None
        if self.spoils(result, changed):
            return None
        return result, LeftOutErrors.of(result)


def _specs(model: Model) -> frozenset[str]:
    return frozenset(e.spec for e in model.effects)


def described(effects: Sequence[Effect]) -> bool:
    """Whether there is a formula among effects: it names no cause."""
    return any(e.kind == "formula" for e in effects)
