"""Cautious values at the end of a way, where least squares says what nobody has measured."""

from __future__ import annotations

from abbe.compcore.diagnosis.screening.left_out.left_out_errors import LeftOutErrors
from abbe.compcore.diagnosis.stepwise.best_on_the_way import foretells_better
from abbe.compcore.diagnosis.stepwise.step import Step
from abbe.compcore.diagnosis.stepwise.unseen import UnseenCampaign
from abbe.compcore.fitting.cautious import cautiously
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.fitting.undetermined.null_space import unsure
from abbe.compcore.fitting.undetermined.parameter_fields import ParameterFields
from abbe.compcore.model.course import runs_away

_NO_WORSE = 1.1
"""Part of χ² per degree of freedom up to which cautious values still say what was measured; of 1
where least squares left less, having followed the noise."""

_SURER = 0.25
"""Part to which the uncertainty over the volume falls, as machines usually err, where a campaign
leaves a part of it unmeasured. 0.9 … 1.05 where all was measured, 0.01 … 0.2 else."""


def held_near_zero(last: Step, unseen: UnseenCampaign | None) -> Step | None:
    """The same model with cautious values (`cautiously`), where a part of it was not measured.

    A model of more motions than a campaign determines fits it, and is worse than none beside it:
    three ball bars, seen on circles 50 mm further, were left 14 times their noise by least squares,
    9.5 without a model, 1.3 with cautious values. What is shown well keeps its value, and where all
    of it is nothing is done.

    Parameters
    ----------
    last
        The end of the way.
    unseen
        A campaign that is never fitted; it must not be predicted worse. None without one.

    Returns
    -------
    The step; None where all was measured, or where less would be left of what was measured.
    """
    result = last.result
    if result.caution is not None or result.model.composition == "exact":
        return None
    before = _running(result)
    held = cautiously(result)
    most = _NO_WORSE * max(1.0, result.chi2_per_dof)
    if held.caution is None or not held.chi2_beside(result) <= most * held.dof:
        return None
    if not (_running(held) < before or _over_the_volume(held) < _SURER * _over_the_volume(result)):
        return None
    if unseen is not None and unseen.spoilt(result.model, held.model):
        return None
    out = LeftOutErrors.of(held, rows=last.held_out.left.folds)
    theirs = last.held_out.left.with_what_it_foretells(out.left)
    if foretells_better(last.held_out.left.residual, theirs, result):
        return None
    return Step("held near 0", None, held, out)


def _over_the_volume(result: FitResult) -> float:
    """How unsure a fit leaves the error over the volume, mm rms."""
    problem, covariance = result.problem, result.model.covariance
    if covariance is None:
        return 0.0
    fields = ParameterFields(problem.model, problem.campaign, problem.layout)
    return unsure(fields, result.theta, covariance)


def _running(result: FitResult) -> int:
    """How many curves say much more where nobody measured than where somebody did."""
    model, positions = result.model, result.problem.campaign.conditions.positions
    along = [(t, getattr(t.effect, "axis", "")) for t in model.terms]
    return sum(
        axis in positions and runs_away(term, model.machine, positions[axis]) is not None
        for term, axis in along
    )
