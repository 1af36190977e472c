"""What was added and cannot be told from nothing by the last fit: taken out at the end."""

from __future__ import annotations

from abbe.compcore.diagnosis.judging.aliases import CERTAINLY_APART
from abbe.compcore.diagnosis.judging.soundness import told_from_nothing
from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.stepwise.growing_model import GrowingModel
from abbe.compcore.diagnosis.uncatalogued.descriptions import surely
from abbe.compcore.effects.base import Effect
from abbe.compcore.errors import FitError
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.model.revise import without_effect


def take_out_noise(growing: GrowingModel) -> bool:
    """Take out effects of which no coefficient differs from 0 by twice its uncertainty.

    What came after them said it better, or two that follow the same thermometer share it between
    them; a correction by them would move the machine by what nobody knows. One stays where χ² is
    certainly larger without it, or left-out blocks are foretold worse by more than their scatter.

    Parameters
    ----------
    growing
        The model at the end of its way.

    Returns
    -------
    Whether any was taken out.
    """
    before = len(growing.added)
    for effect in [e for e in growing.added if e not in growing.described]:
        if told_from_nothing(growing.last.result.model, effect):
            continue
        growing.progress(f"without {effect.kind}")
        result = _not_needed(growing, effect)
        if result is not None and not growing.spoils(result, (effect,)):
            growing.make("removed", effect, result, LeftOutErrors.of(result))
            growing.added.remove(effect)
    return len(growing.added) < before


def _not_needed(growing: GrowingModel, effect: Effect) -> FitResult | None:
    """The fit without an effect; None where the campaign surely needs it."""
    now = growing.last.result
    less, _ = without_effect(now.model, effect.spec)
    try:
        result = fit(less, growing.campaign, near=True)
    except FitError:
        return None
    if result.chi2_beside(now) - now.chi2 > CERTAINLY_APART * now.chi2_per_dof:
        return None
    with_it, without = LeftOutErrors.beside(now, result, (effect,))
    needed = surely(without.left, with_it.left, now.thin.problem.weight)
    return None if needed else result
