"""All error motions of the linear axes at once: what every axis has, before what imitates it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from abbe.compcore.diagnosis.judging.foretelling import WORTH
from abbe.compcore.diagnosis.judging.soundness import sound
from abbe.compcore.diagnosis.screening.body_motions import motion, of_a_body
from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.stepwise.best_on_the_way import foretells_better
from abbe.compcore.diagnosis.stepwise.growing_model import FALLS, GrowingModel
from abbe.compcore.diagnosis.stepwise.step import leaves_noise
from abbe.compcore.diagnosis.uncatalogued.chosen import grown, of_positions_alone
from abbe.compcore.diagnosis.verdict import Diagnosis
from abbe.compcore.effects import Positioning, Scale, ScaleExpansion
from abbe.compcore.effects.base import Effect
from abbe.compcore.errors import FitError
from abbe.compcore.fitting.cautious import cautiously
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import identity, without_effect

_AXES = 2
"""Linear axes of which a motion has to be established before those of all are asked."""
_FEWEST = 3


def whole_body(growing: GrowingModel, diagnosis: Diagnosis, *, axes: int = _AXES) -> bool:
    """Add the error motions of all linear axes and their scales' expansions, if worth it.

    Taken one by one, a motion is imitated by what few rows tell from it: the sag of a ram, a turn
    that grows along another axis, the scale of a set-up; and what needs several others, as the
    expansion of a scale does, foretells nothing before they are there. All of them are added that a
    machine can have, whatever each is worth: what one of them would have said goes else into the
    others, or into rarer causes, and another start would lead elsewhere. Of what is not measured
    the end is held near 0 (`held_near_zero`). A formula of the positions alone that was described
    before stood for them: where they foretell left-out blocks as well without it, it goes.

    Parameters
    ----------
    growing
        The model; where it has all motions nothing is done.
    diagnosis
        What it lacks.
    axes
        Of how many axes motions have to be established.

    Returns
    -------
    Whether they were added.
    """
    machine = growing.last.result.model.machine
    wanted = [e.found.candidate.effect for e in diagnosis.established]
    moving = {a for e in wanted if of_a_body(e, machine) for a in _axes_of(e)}
    if not growing.bodies:
        return False
    if growing.of_bodies and _scales_expand(growing, diagnosis):
        return True
    if len(moving) < axes:
        return False
    known = {motion(e) for e in growing.last.result.model.effects}
    missing: dict[object, Effect] = {}
    for effect in (f.candidate.effect for f in diagnosis.ranked):
        if of_a_body(effect, machine) and motion(effect) not in known:
            missing.setdefault(motion(effect), effect)
    there = (*growing.last.result.model.effects, *missing.values())
    moved = {e.axis for e in there if isinstance(e, Positioning)}
    missing = {
        key: e for key, e in missing.items() if not (isinstance(e, Scale) and e.axis in moved)
    }
    stood = [e for e in growing.described if e.kind == "formula" and of_positions_alone(e, machine)]
    if stood and in_place_of(growing, stood, list(missing.values())):
        return True
    body = _sound(growing, growing.last.result.model, list(missing.values()))
    if len(body) < _FEWEST or not growing.once(body):
        return False
    growing.progress("all error motions of the linear axes")
    more = grown(growing.last.result.model, body)
    added = [one for _, one in more]
    found = growing.better(more[-1][0], added, 1.0 - WORTH)
    plain = _alone(growing, wanted)
    if found is None:
        # of lines that were measured once each, least squares foretells none that is left out
        found = growing.better(more[-1][0], added, 1.0 - WORTH, cautious=True)
    if found is None or (plain and _give_way(plain, found[0], [*added, *wanted])):
        return False
    growing.of_bodies = added
    growing.instruments = _of_instruments(growing.last.result.model)
    growing.make_together("added with the others", "added with the others", more, *found)
    return True


def _alone(growing: GrowingModel, wanted: Sequence[Effect]) -> FitResult | None:
    """The fit with the established causes alone, where it predicts left-out blocks better."""
    more = grown(growing.last.result.model, wanted)
    found = growing.better(more[-1][0], [one for _, one in more], 1.0 - WORTH) if more else None
    return None if found is None else found[0]


def _give_way(plain: FitResult, motions: FitResult, effects: Sequence[Effect]) -> bool:
    """Whether the established causes alone foretell left-out blocks surely better than beside all.

    Where holes scatter about where a machine drills them, all motions beside the squareness that is
    there follow the scatter, and foretell nothing. Causes that are no motions, as a spindle that
    grows, stand beside both: what they foretell speaks for neither.
    """
    there = {identity(e) for e in motions.model.effects}
    causes = [e for e in plain.model.effects if identity(e) not in there]
    beside = motions
    if causes:
        whole = grown(motions.model, causes)[-1][0]
        beside = fit(whole, motions.problem.campaign, near=True)
    one, two = LeftOutErrors.beside(plain, cautiously(beside), effects)
    return foretells_better(one.left.residual, two.left.residual, beside)


def _scales_expand(growing: GrowingModel, diagnosis: Diagnosis) -> bool:
    """Add the scales' expansions, asked again beside what instruments do.

    A gauge that was taken for one of steel hides what the scales do, and where they cannot be said
    something else is: an expansion of the workpiece by a scale's thermometer.
    """
    model = growing.last.result.model
    count = _of_instruments(model)
    if count == growing.instruments:
        return False
    growing.instruments = count
    known = {motion(e) for e in model.effects}
    missing: dict[object, Effect] = {}
    for effect in (f.candidate.effect for f in diagnosis.ranked):
        own = isinstance(effect, ScaleExpansion) and of_a_body(effect, model.machine)
        if own and motion(effect) not in known:
            missing.setdefault(motion(effect), effect)
    body = _sound(growing, model, list(missing.values()))
    return bool(body) and growing.add_once_together(body, 1.0 - WORTH)


def _of_instruments(model: Model) -> int:
    return sum(e.scope == "instrument" for e in model.effects)


def in_place_of(
    growing: GrowingModel, formulas: Sequence[Effect], missing: Sequence[Effect]
) -> bool:
    """Add error motions and take out the formulas that stood for them, if that foretells as well.

    Beside each other they share what was measured in some way that no campaign tells, and work
    against each other everywhere else.
    """
    base = growing.last.result.model
    for formula in formulas:
        base, _ = without_effect(base, formula.spec)
    body = _sound(growing, base, missing)
    if len(body) < _FEWEST:
        return False
    growing.progress("error motions in place of a formula")
    if not _as_good(growing, grown(base, body)[-1][0], body):
        return False
    kept = worth_it(growing, base, body)
    if not _as_good(growing, grown(base, kept)[-1][0], kept):
        return False
    growing.once(body)
    more = grown(growing.last.result.model, kept)
    growing.of_bodies = [one for _, one in more]
    beside = fit(more[-1][0], growing.campaign, near=True)
    growing.make_together(
        "added with the others", "added with the others", more, beside, LeftOutErrors.of(beside)
    )
    growing.take_out(formulas)
    return True


def _as_good(growing: GrowingModel, model: Model, effects: Sequence[Effect]) -> bool:
    """Whether a model foretells left-out blocks as well as the present one, or leaves noise.

    Where each motion was measured on one line or two, without that line nothing is known of it:
    left-out blocks then say less than that nothing but noise is left.
    """
    found = growing.better(model, effects, math.inf)
    if found is None:
        return False
    return leaves_noise(found[0]) or growing.better(model, effects, 1.0) is not None


def worth_it(growing: GrowingModel, before: Model, body: Sequence[Effect]) -> list[Effect]:
    """Those of some effects without which left-out blocks are foretold worse.

    All are fitted beside the model as it was `before`; then the least worth is taken out first.
    """
    kept = list(body)
    now = fit(grown(before, kept)[-1][0], growing.campaign, near=True)
    lost = {e.spec: _lost(now, e, growing) for e in kept}

    def first(effect: Effect) -> tuple[bool, bool, float]:
        superfluous = lost[effect.spec] <= 1.0 / FALLS
        # to a tool of one length a turn is a shift; of what says the same the plainer one stays
        size = -float(len(effect.linear(before.machine)))
        return not superfluous, effect.kind != "angular", size if superfluous else lost[effect.spec]

    order = sorted(kept, key=first)
    for effect in order:
        growing.progress(f"without {effect.kind}")
        if len(kept) > 1 and _lost(now, effect, growing) <= 1.0 / FALLS:
            kept.remove(effect)
            now = fit(grown(before, kept)[-1][0], growing.campaign, near=True)
    return kept


def _lost(now: FitResult, effect: Effect, growing: GrowingModel) -> float:
    """By how many times the left-out χ² rises without an effect."""
    less, _ = without_effect(now.model, effect.spec)
    try:
        without = fit(less, growing.campaign, near=True)
    except FitError:
        return float("inf")
    one, other = LeftOutErrors.beside(now, without, (effect,))
    return one.falls_to(other, without, bound=False)


def _sound(growing: GrowingModel, model: Model, body: Sequence[Effect]) -> list[Effect]:
    """Those whose values, fitted with all others beside a model, can be."""
    if not body:
        return []
    try:
        result = fit(grown(model, body)[-1][0], growing.campaign, near=True)
    except FitError:
        return []
    return [e for e in body if sound(result.model, e) and _expands(result, e)]


def _expands(result: FitResult, effect: Effect) -> bool:
    """Whether what is a scale's expansion is not surely beyond what a scale's can be."""
    if not isinstance(effect, ScaleExpansion):
        return True
    term = next(t for t in result.model.terms if t.effect == effect)
    (alpha,) = effect.linear(result.model.machine)
    value = term.values[alpha.name]
    low, high = alpha.plausible
    sd = 2.0 * (value.sd or 0.0)
    return low - sd <= value.value <= high + sd


def _axes_of(effect: Effect) -> tuple[str, ...]:
    axes = getattr(effect, "axes", None)
    return tuple(axes) if axes else (str(getattr(effect, "axis", "")),)
