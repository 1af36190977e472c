"""What no cause explains, described: beside the causes, or in place of error motions."""

from __future__ import annotations

from collections.abc import Sequence

from abbe.compcore.campaign.campaign import Kind
from abbe.compcore.campaign.resolution import of_step, step_of
from abbe.compcore.diagnosis.findings import measured_kinds
from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.stepwise.growing_model import GrowingModel, described
from abbe.compcore.diagnosis.uncatalogued.chosen import (
    Grown,
    as_good_beside,
    best_beside,
    best_instead,
    grown,
    of_positions_alone,
)
from abbe.compcore.diagnosis.verdict import Diagnosis
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.cautious import cautiously
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.model.revise import without_effect


def describe(growing: GrowingModel, diagnosis: Diagnosis) -> bool:
    """Describe what no cause explains, where that foretells left-out blocks surely better.

    Of all descriptions the one that foretells best: beside the causes; or over the whole volume
    in place of the error motions that were added, where they foretell surely worse.
    """
    growing.progress("describing what no cause explains")
    before = growing.last.result
    motions = [e for e in growing.added if of_positions_alone(e, before.model.machine)]
    if motions and not described(before.model.effects):
        less = before.model
        for effect in motions:
            less, _ = without_effect(less, effect.spec)
        instead = best_instead(cautiously(before), less, growing.campaign, growing.refused_now)
        if instead is not None:
            found = best_beside(before, growing.campaign, diagnosis, growing.refused_now)
            kept = found is not None and as_good_beside(before, found[1], less, instead)
            return (not kept and _replace(growing, motions, instead)) or _beside(growing, found)
    return _beside(growing, best_beside(before, growing.campaign, diagnosis, growing.refused_now))


def _beside(growing: GrowingModel, found: tuple[Grown, FitResult] | None) -> bool:
    """Describe beside the causes, unless that is how readings were rounded, or spoils others.

    Nor where a body that lagged behind its signal then lags by more than the campaign lasted.
    """
    if found is None:
        return False
    more, result = found
    out = LeftOutErrors.of(result)
    if (
        _of_steps(result, out)
        or growing.goes_late(result)
        or growing.spoils(result, [one for _, one in more])
    ):
        return False
    growing.make_together("described", "described", more, result, out)
    return True


def _of_steps(result: FitResult, out: LeftOutErrors) -> bool:
    """Whether a description leaves less of left-out blocks than readings that step are unsure by.

    What it describes then is how the readings were rounded at these very places.
    """
    kinds = measured_kinds(result)
    left = out.rotations if kinds == (Kind.ROTATION,) else out.lengths
    return left < of_step(step_of(result.problem.campaign, kinds))


def _replace(growing: GrowingModel, motions: Sequence[Effect], effects: Sequence[Effect]) -> bool:
    """Describe, then take out error motions that were added before."""
    more = grown(growing.last.result.model, effects)
    result = fit(more[-1][0], growing.campaign, near=True)
    if growing.spoils(result, [one for _, one in more]):
        return False
    growing.make_together("described", "described", more, result, LeftOutErrors.of(result))
    growing.take_out(motions)
    return True
