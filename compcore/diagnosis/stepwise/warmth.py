"""Warmth in more detail: further thermometers, all of them together, lags, second bodies."""

from __future__ import annotations

from abbe.compcore.diagnosis.judging.soundness import worth
from abbe.compcore.diagnosis.regression import regression
from abbe.compcore.diagnosis.stepwise.growing_model import FALLS, GrowingModel, described
from abbe.compcore.diagnosis.thermometers import (
    further_thermometers,
    jointly,
    of_temperatures,
    warmth_together,
)
from abbe.compcore.diagnosis.uncatalogued.chosen import grown
from abbe.compcore.diagnosis.uncatalogued.descriptions import LEAST
from abbe.compcore.diagnosis.verdict import Diagnosis
from abbe.compcore.effects.base import Effect
from abbe.compcore.effects.catalogue.temperature.shifts import ThermalOffset
from abbe.compcore.effects.signals import LaggedEffect
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.revise import with_effect, without_effect

MOST_TRIED = 6
"""So many of the leading candidates are tried one after the other."""


def sharpen(growing: GrowingModel, diagnosis: Diagnosis) -> bool:
    """Add further thermometers where warmth is established and they predict better."""
    warm = [e for e in growing.added if e in growing.last.result.model.effects]
    further = further_thermometers(diagnosis, warm)
    if not further and diagnosis.verdict == "unexplained":
        further = warmth_together(diagnosis)
    for effects in further[:MOST_TRIED]:
        if len(effects) == 1:
            if growing.add(effects[0]):
                return True
        elif growing.add_together(effects):
            return True
    return False


def regress(growing: GrowingModel, diagnosis: Diagnosis) -> bool:
    """Take the thermometers by which a linear regression foretells surely better.

    Beside what is there, or in place of the warmth that was found.
    """
    growing.progress("thermometers together")
    effects = jointly(diagnosis)
    if effects and growing.add_once_together(effects, 1.0 - LEAST):
        return True
    before = growing.last.result
    warm = [e for e in growing.added if of_temperatures(e, before.model.machine)]
    if not warm or growing.regressed == len(growing.steps) or described(growing.added):
        return False
    growing.regressed = len(growing.steps)
    less = before.model
    for effect in warm:
        less, _ = without_effect(less, effect.spec)
    instead = regression(fit(less, growing.campaign, near=True))
    if not instead:
        return False
    more = grown(less, instead)
    found = growing.better(more[-1][0], [one for _, one in more], 1.0 - LEAST)
    if found is None:
        return False
    growing.take_out(warm)
    growing.make_together("added together", "added", more, *found)
    return True


def detail(growing: GrowingModel, diagnosis: Diagnosis) -> bool:
    """More detail in what is there, where structure is left that no further cause explains.

    What was refused while causes were still missing is tried once more.
    """
    if diagnosis.verdict == "complete":
        return False
    before = len(growing.steps)
    lag(growing, again=True)
    return bodies(growing, again=True) or len(growing.steps) > before


def lag(growing: GrowingModel, *, again: bool = False) -> None:
    """Put signals of effects that were added behind a lag, where that predicts better.

    `again`: also where it was refused beside another model than now.
    """
    for effect in list(growing.added):
        if not isinstance(effect, LaggedEffect) or effect.tau is not None:
            continue
        growing.progress(f"a lag for {effect.kind}")
        lagged = _detailed(growing, "lagged", effect, {"tau": "fit"}, again=again)
        if not lagged and isinstance(effect, ThermalOffset):
            # a lag may be hidden by a body that began elsewhere
            elsewhere = {"tau": "fit", "start": "fit"}
            _detailed(growing, "began elsewhere", effect, elsewhere, again=again)


def bodies(growing: GrowingModel, *, again: bool = False) -> bool:
    """A second body behind a lagged signal, or one that began elsewhere than in equilibrium.

    `again`: also where it was refused beside another model than now.
    """
    before = len(growing.steps)
    for key, action in (("start", "began elsewhere"), ("tau2", "second body")):
        for effect in list(growing.added):
            lagged = isinstance(effect, ThermalOffset) and effect.tau == "fit"
            if lagged and getattr(effect, key) is None:
                growing.progress(f"{effect.kind}: {action}")
                _detailed(growing, action, effect, {key: "fit"}, again=again)
    return len(growing.steps) > before


def _detailed(
    growing: GrowingModel, action: str, effect: Effect, detail: dict[str, str], *, again: bool
) -> bool:
    """Exchange an effect for one of more detail, where that predicts better."""
    fuller = effect.model_copy(update=detail)
    if growing.refused_now(fuller) or (fuller in growing.refused and not again):
        return False
    before = growing.last.result.model
    more, _ = with_effect(before, fuller.kind, fuller.where())
    found = growing.better(more, (fuller,), FALLS)
    if found is None or not worth(growing.last.result, found[0]):
        if found is not None:
            growing.why[fuller.spec] = "it is not worth its coefficients"
        growing.refused[fuller] = len(growing.steps)
        return False
    growing.make(action, fuller, *found)
    growing.added[growing.added.index(effect)] = fuller
    return True
