"""What was added and cannot be told from nothing by the last fit: taken out at the end."""

from __future__ import annotations

from abbe.compcore.diagnosis.judging.foretelling import WORTH
from abbe.compcore.diagnosis.judging.soundness import told_from_nothing
from abbe.compcore.diagnosis.stepwise.growing_model import GrowingModel


def take_out_noise(growing: GrowingModel) -> bool:
    """Take out effects of which no coefficient differs from 0 by twice its uncertainty.

    What came after them said it better, or two that follow the same thermometer share it between
    them; a correction by them would move the machine by what nobody knows. One stays where without
    it left-out blocks are foretold worse by what is worth a cause.

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
        growing.leave_out(effect, 1.0 + WORTH)
    return len(growing.added) < before
