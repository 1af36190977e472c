"""Whether a description in temperatures or loads holds beyond the values that it was made of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.left_out.crossvalidation import FOLDS, setup_rows
from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.machine.conditions import Conditions

_OF_ROWS = 4
"""So many parts are the rows cut into by a signal's size; the first and the last are its ends."""
_NO_WORSE = 1.0 + 1e-9
"""Part of the left-out χ² of an end up to which nothing is lost: what is the same rounds."""


def holds_at_the_ends(before: FitResult, result: FitResult, added: Sequence[Effect]) -> bool:
    """Whether the lowest and the highest values of each signal are foretold no worse from the rest.

    Days that are left out one by one lie between others that are as warm, and so does an hour of a
    day: there a polynomial of temperatures draws whatever lagged. Tomorrow is warmer than all of
    them, or colder. What only the ends determine foretells nothing of them, and is not refused for
    it; what follows no signal is not asked.
    """
    weight = before.thin.problem.weight
    conditions = before.thin.problem.campaign.conditions
    for name in sorted({name for effect in added for name in effect.signals_needed()}):
        for rows in _ends(conditions, conditions.signal(name)):
            was, now = (LeftOutErrors.of(r, rows=[rows]).left for r in (before, result))
            after = was.with_what_it_foretells(now)
            held, left = (np.sum((v[rows] * weight[rows]) ** 2) for v in (was.residual, after))
            if left > _NO_WORSE * held:
                return False
    return True


def _ends(conditions: Conditions, signal: NDArray[np.float64]) -> Iterator[NDArray[np.int64]]:
    """The rows of a signal's lowest values and of its highest; of many set-ups whole ones."""
    own = setup_rows(conditions)
    units = own if len(own) >= FOLDS else [np.array([row]) for row in range(conditions.n)]
    order = np.argsort([np.mean(signal[rows]) for rows in units], kind="stable")
    count = len(units) // _OF_ROWS
    for part in (order[:count], order[len(order) - count :]):
        if len(part):
            yield np.sort(np.concatenate([units[i] for i in part]))
