"""A plan carried out on a simulated machine: what a fit then really leaves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.fitting.design.design_matrix import Problem
from abbe.compcore.fitting.fit import fit
from abbe.compcore.planning.knowledge import VolumeError, scales
from abbe.compcore.planning.plan import SurveyPlan

F64 = NDArray[np.float64]

AMOUNT = 0.1
"""Standard deviation of a simulated machine's parameters, in believable sizes."""


@dataclass(frozen=True, slots=True)
class Reached:
    """What a simulated campaign reached.

    Attributes
    ----------
    before, after
        Error of the machine over the volume, uncorrected and corrected with the fitted model, root
        of the mean square, mm.
    stated
        What the fit's covariance says of it, mm.
    """

    before: float
    after: float
    stated: float


def carry_out(plan: SurveyPlan, seed: int = 1, amount: float = AMOUNT) -> Reached:
    """Measure a machine with random errors by a plan, fit, and look at the volume.

    Parameters
    ----------
    amount
        Standard deviation of the machine's parameters, in believable sizes.

    Raises
    ------
    ValueError
        When the model has nothing to be fitted.
    """
    rng = np.random.default_rng(seed)
    model = plan.task.model
    blank = plan.rows()
    problem = Problem(model, blank)
    truth = problem.start()
    size = problem.layout.model_size
    truth[:size] += amount * problem.layout.scale[:size] * rng.standard_normal(size)
    for i, parameter in problem.layout.searched.items():
        # a time constant is no error about zero: it is one of those that a machine may have
        truth[i] = rng.choice(parameter.starts)
    truth[size:] += 0.3 * rng.standard_normal(len(truth) - size)
    noise = blank.sd * rng.standard_normal(blank.n)
    measured = replace(blank, value=problem.predicted(truth) + noise)
    result = fit(model, measured)
    volume = VolumeError.of(plan.task)
    scale = scales(model)
    points = len(volume.field) / 3
    found = result.theta[:size] / scale
    true = truth[:size] / scale
    covariance = result.model.covariance
    if covariance is None:
        raise ValueError("a fitted model has a covariance")
    return Reached(
        float(np.linalg.norm(volume.field @ true) / np.sqrt(points)),
        float(np.linalg.norm(volume.field @ (found - true)) / np.sqrt(points)),
        volume.mean(covariance / np.outer(scale, scale)),
    )
