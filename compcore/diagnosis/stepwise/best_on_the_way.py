"""Back from the end of a way to the step that foretold best, where the end foretells worse."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.judging.foretelling import WORTH
from abbe.compcore.diagnosis.screening.left_out.blocks import Blocks
from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.stepwise.step import Step
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.fit import FitResult

F64 = NDArray[np.float64]

_FEWEST_BLOCKS = 3
"""From which on their scatter says how sure a gain is."""


def foretells_better(mine: F64, theirs: F64, result: FitResult) -> bool:
    """Whether left-out blocks are predicted better by what is worth a cause, and surely.

    Surely: the mean gain over the blocks is larger than the standard error of that mean.

    Parameters
    ----------
    mine, theirs
        What two fits leave of the same left-out rows, mm or rad, (n,).
    result
        The fit by whose uncertainties both are judged.
    """
    thin = result.thin
    weight = thin.problem.weight
    if mine.shape != theirs.shape:
        return False
    gain = (theirs**2 - mine**2) * weight**2
    if not float(gain.sum()) > WORTH * float(((theirs * weight) ** 2).sum()):
        return False
    blocks = Blocks.of(thin.problem.campaign.conditions, thin.model.machine).usual
    each = np.array([float(gain[rows].sum()) for rows in blocks])
    if len(each) < _FEWEST_BLOCKS:
        return False
    return float(each.sum()) > math.sqrt(len(each)) * float(each.std(ddof=1))


def best_on_the_way(steps: tuple[Step, ...]) -> Step | None:
    """The step, the start among them, that predicts left-out blocks better than the last one.

    Each step is judged when it is made, beside the one before it; many that lose a little lose much
    together, and what is taken out at the end may be missed where nobody asked. All are seen on the
    blocks of the last one, and where that alone would foretell nothing (a line that was measured
    once) it counts as no worse. A formula that gave way to causes did so whatever it foretold.

    Parameters
    ----------
    steps
        The way; steps before readings were set aside are of other rows and do not count.

    Returns
    -------
    The best step; None where none predicts surely better than the last.
    """
    last = steps[-1]
    from_here = max((i for i, s in enumerate(steps) if s.action == "set aside"), default=0)
    formulas = _formulas(last)
    better: list[tuple[float, Step]] = []
    for step in steps[from_here:-1]:
        if _figure(step) >= _figure(last) or not _formulas(step) <= formulas:
            continue
        before = LeftOutErrors.of(step.result, rows=last.held_out.left.folds).left
        theirs = before.with_what_it_foretells(last.held_out.left)
        if foretells_better(before.residual, theirs, last.result):
            weight = last.result.thin.problem.weight
            better.append((float(np.sum((before.residual * weight) ** 2)), step))
    return min(better, key=lambda found: found[0])[1] if better else None


def _figure(step: Step) -> float:
    return step.held_out.rotations if step.of_rotations else step.held_out.lengths


def _formulas(step: Step) -> set[Effect]:
    return {e for e in step.result.model.effects if e.kind == "formula"}
