"""What the lever rule leaves out: angles so large that errors no longer add up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.diagnosis.screening.pool import MATERIAL
from abbe.compcore.effects.base import Effect
from abbe.compcore.fitting.fit import FitResult

F64 = NDArray[np.float64]

Valued = tuple[Effect, Mapping[str, float], F64]
"""An effect, its non-linear parameters, and its linear ones, in order."""


def beyond_first_order(result: FitResult, variance: float, added: Sequence[Valued] = ()) -> bool:
    """Whether errors composed in full differ from their sum by as much as is worth a cause.

    An encoder's zero that is 20 mrad off moves a point half a metre away by 10 mm, and by 0.1 mm
    less than the lever rule says.

    Parameters
    ----------
    result
        A model fitted to a campaign.
    variance
        Noise variance in units of the weights.
    added
        Effects beside it, with their values. What is measured then decides, too: less must be left
        in full than added up. An angle about one axis alone adds up however large it is.
    """
    problem, theta = result.problem, result.theta
    if problem.model.composition == "exact":
        return False
    motions = dict(problem.error_motions(theta))
    for effect, nonlinear, coefficients in added:
        for motion in problem.effect_motions(effect, nonlinear, theta):
            value = motion.amount(coefficients)
            motions[motion.error_motion] = motions.get(motion.error_motion, 0.0) + value
    if not any(c.rotation for c in motions):
        return False
    seen, weight = problem.observation(theta), problem.weight
    added_up, in_full = (seen.values(motions, how) for how in ("first-order", "exact"))
    missed = result.eliminator.project((in_full - added_up) * weight)
    if float(np.mean(missed**2)) <= MATERIAL * variance:
        return False
    if not added:
        return True
    left = problem.residual(theta) - (added_up - problem.predicted(theta)) * weight
    left = result.eliminator.project(left)
    return float(np.sum((left - missed) ** 2)) < float(np.sum(left**2))
