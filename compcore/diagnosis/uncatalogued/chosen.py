"""The description that foretells left-out blocks best, beside the causes or in place of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from abbe.compcore.campaign.campaign import Campaign
from abbe.compcore.diagnosis.findings import Findings
from abbe.compcore.diagnosis.screening.candidates import RIGID
from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.uncatalogued.beyond_the_ends import holds_at_the_ends
from abbe.compcore.diagnosis.uncatalogued.descriptions import (
    LEAST,
    descriptions,
    different,
    surely,
    taken,
)
from abbe.compcore.diagnosis.uncatalogued.other_lines import foretells_other_lines
from abbe.compcore.diagnosis.uncatalogued.over_the_volume import smooth_errors
from abbe.compcore.effects.base import Effect
from abbe.compcore.errors import FitError
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.machine.machine import Machine
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import identity, with_effect

Grown = list[tuple[Model, Effect]]
"""A model with one effect more each time, and that effect."""

Refused = Callable[[Effect], bool]


def grown(model: Model, effects: Iterable[Effect]) -> Grown:
    """A model with one effect more and more, not fitted, and each effect as the model has it.

    Raises
    ------
    InputError
        As `with_effect`.
    """
    found: Grown = []
    for effect in effects:
        model, added = with_effect(model, effect.kind, effect.where())
        found.append((model, added))
    return found


def best_beside(
    before: FitResult, campaign: Campaign, diagnosis: Findings, refused: Refused
) -> tuple[Grown, FitResult] | None:
    """The description that foretells best beside all causes of a model; None where none does.

    Parameters
    ----------
    before
        The model's fit.
    campaign
        Its rows.
    diagnosis
        Of that fit.
    refused
        Whether an effect has been refused beside this model.
    """
    weight = before.thin.problem.weight
    best: tuple[float, Grown, FitResult] | None = None
    found = list(descriptions(diagnosis))
    chances = different(found)
    whole = _has_all_motions(before.model, diagnosis)
    for effects in found:
        effects = tuple(e for e in effects if e not in before.model.effects)
        if not effects or any(map(refused, effects)):
            continue
        more = grown(before.model, effects)
        try:
            result = fit(more[-1][0], campaign, near=True)
        except FitError:
            continue
        added = [one for _, one in more]
        along = judged_along(added, before.model.machine)
        was = LeftOutErrors.of(before, added, along=along)
        now = LeftOutErrors.of(result, added, along=along)
        after = replace(now.left, residual=was.left.with_what_it_foretells(now.left))
        left = float(np.sum((after.residual * weight) ** 2))
        if best is not None and left >= best[0]:
            continue
        fall = 1.0 - was.falls_to(now, result, bound=False)
        if not taken(fall, was.left, after, weight, chances):
            continue
        if along and not _between(before, result, added):
            continue
        if not holds_at_the_ends(before, result, added):
            continue
        if not whole or foretells_other_lines(before, result, added):
            best = left, more, result
    return None if best is None else best[1:]


def _has_all_motions(model: Model, diagnosis: Findings) -> bool:
    """Whether a model has all error motions that were tried: nothing stands for one of them."""
    known = {identity(e) for e in model.effects}
    tried = (f.candidate.effect for f in diagnosis.ranked)
    return not any(e.kind in RIGID and identity(e) not in known for e in tried)


def _between(before: FitResult, result: FitResult, added: Sequence[Effect]) -> bool:
    """Whether a curve that other passes foretell says nothing worse of places left out.

    A table says nothing between its targets that these do not say, and is not asked; nor is a curve
    with as many coefficients as there are targets.
    """
    machine = before.model.machine
    places = before.thin.problem.campaign.coverage().places
    for effect in added:
        most = max(places[axis] for axis in effect.positions_used(machine))
        if getattr(effect, "shape", None) == "table" or len(effect.linear(machine)) >= most:
            return True
    was, now = (LeftOutErrors.of(r, added) for r in (before, result))
    return was.falls_to(now, result, bound=False) <= 1.0


def judged_along(added: Sequence[Effect], machine: Machine) -> Sequence[str]:
    """The axes of whose passes each may be left out to judge what was added.

    What follows a temperature or a load says the same on neighbouring passes, whether it holds or
    not: another day has to say it again.
    """
    used = {tuple(e.positions_used(machine)) for e in added}
    if len(used) > 1 or any(e.signals_needed() for e in added):
        return ()
    return used.pop()


def of_positions_alone(effect: Effect, machine: Machine) -> bool:
    """Whether a machine's effect is a function of positions: not of warmth, time or direction."""
    return (
        effect.scope != "instrument"
        and bool(effect.positions_used(machine))
        and not effect.signals_needed()
        and not effect.directions_used()
    )


def best_instead(
    before: FitResult, less: Model, campaign: Campaign, refused: Refused
) -> Sequence[Effect] | None:
    """A smooth error over the volume that foretells better than motions that were added.

    Error motions of single axes may imitate a machine that has no such axes, an arm of joints that
    is told X, Y and Z: all together they take more coefficients, and say worse what lies between.

    Parameters
    ----------
    before
        The fit of the model with them.
    less
        The model without them.
    campaign
        The rows.
    refused
        Whether an effect has been refused beside this model.
    """
    weight = before.thin.problem.weight
    best: tuple[float, Sequence[Effect]] | None = None
    for effects in smooth_errors(less.machine, campaign):
        if any(map(refused, effects)):
            continue
        try:
            alone = fit(grown(less, effects)[-1][0], campaign, near=True)
        except FitError:
            continue
        was, now = (LeftOutErrors.of(r, effects).left for r in (before, alone))
        held, left = (float(np.sum((x.residual * weight) ** 2)) for x in (was, now))
        if left > (1.0 - LEAST) * held or not surely(was, now, weight):
            continue
        if best is None or left < best[0]:
            best = left, effects
    return None if best is None else best[1]


def as_good_beside(
    before: FitResult, beside: FitResult, less: Model, instead: Sequence[Effect]
) -> bool:
    """Whether a description beside error motions foretells no worse than another in their place.

    What has straight axes keeps its motions: they are causes, and a formula is none.

    Parameters
    ----------
    before
        The fit with the motions, whose rows and weights count.
    beside
        With the motions and a description beside them.
    less, instead
        The model without them, and what stands in their place.
    """
    campaign, weight = before.problem.campaign, before.thin.problem.weight
    alone = fit(grown(less, instead)[-1][0], campaign, near=True)
    kept, left = (
        float(np.sum((LeftOutErrors.of(r, instead).left.residual * weight) ** 2))
        for r in (beside, alone)
    )
    return kept <= left
