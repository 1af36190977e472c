"""What earlier campaigns showed, kept at the end of a way that began with a fitted model."""

from __future__ import annotations

from collections.abc import Iterator

from abbe.compcore.diagnosis.renewing import NotRenewedError, accused, known_of_others, renew
from abbe.compcore.diagnosis.stepwise.step import Step
from abbe.compcore.diagnosis.stepwise.unseen import UnseenCampaign
from abbe.compcore.fitting.fit import fit
from abbe.compcore.model.model import Model
from abbe.compcore.model.revise import with_effect

_NO_WORSE = 1.1
"""Part of χ² per degree of freedom up to which values that count what was known before still say
what was measured; of 1 where least squares left less."""


def accused_steps(given: Model, first: Step, last: Step) -> Iterator[Step]:
    """Steps that add what has changed outside the model: a thermometer, a scale.

    Only where what was known before is kept: one campaign does not tell a thermometer that reads
    too much from the scale that it stands on.
    """
    result = first.result
    if not known_of_others(given, set(result.problem.campaign.files.values())):
        return
    model = last.result.model
    for effect in accused(given, result, last.result):
        model, _ = with_effect(model, effect.kind, effect.where())
        more = fit(model, result.problem.campaign, near=True)
        yield Step("added", effect, more, last.held_out)


def kept_from_before(
    given: Model, first: Step, last: Step, unseen: UnseenCampaign | None
) -> Step | None:
    """The last model with what the given one knew of all that has not changed.

    A check of few lines, fitted alone, forgets what an acceptance of days showed: after a change of
    squareness by 38 µrad the others were left at ± 65 to ± 210 µrad.

    Parameters
    ----------
    given
        The model where the way began.
    first, last
        Its effects fitted to the campaign, and the end of the way.
    unseen
        A campaign that is never fitted; it must not be predicted worse. None without one.

    Returns
    -------
    The step; None where nothing was known, or where more has changed than some effects.
    """
    campaign = first.result.problem.campaign
    if not known_of_others(given, set(campaign.files.values())):
        return None
    try:
        found = renew(given, first.result, last.result)
    except NotRenewedError:
        return None
    most = _NO_WORSE * max(1.0, last.result.chi2_per_dof)
    if not found.chi2_beside(last.result) <= most * found.dof:
        return None
    if unseen is not None and unseen.spoilt(last.result.model, found.model):
        return None
    return Step("kept from before", None, found, last.held_out)
