"""A fitted model renewed by a later campaign, but for what has changed since it was fitted."""

from __future__ import annotations

from collections.abc import Mapping

from abbe.compcore.diagnosis.changed import Standing, standing
from abbe.compcore.diagnosis.findings import Findings
from abbe.compcore.effects.base import Effect
from abbe.compcore.errors import FitError
from abbe.compcore.fitting.fit import FitResult
from abbe.compcore.fitting.renewed import renewed
from abbe.compcore.model.model import Model
from abbe.compcore.sentences import Sentence, joined, said
from abbe.compcore.units import in_digits, read_in

_MUCH = 5.0
"""Times as unsure as before from which on it is said."""


class NotRenewedError(FitError):
    """What was known before cannot count beside a campaign."""


def known_of_others(model: Model, campaign_files: set[str]) -> bool:
    """Whether a model knows its values from other campaigns than these (their SHA-256), too."""
    if model.covariance is None or not model.terms or not all(t.fitted for t in model.terms):
        return False
    if not campaign_files:
        return False  # rows of no file: whether they were fitted before nobody can say
    return not model.fitted_to & campaign_files or _renewed_with(model, campaign_files) is not None


def _renewed_with(model: Model, campaign_files: set[str]) -> float | None:
    """The variance with which these very campaigns were the last to renew a model; else None."""
    record = model.fit.get("renewed")
    if not campaign_files or not isinstance(record, Mapping):
        return None
    by, variance = record.get("by"), record.get("variance")
    if not isinstance(by, list) or set(map(str, by)) != campaign_files:
        return None
    return float(variance) if isinstance(variance, int | float) and variance > 0.0 else None


def renews(diagnosis: Findings) -> bool:
    """Whether what was known before can count beside the campaign that was diagnosed."""
    problem, holds = diagnosis.whole.problem, diagnosis.standing
    if holds is None or holds.suspicions or not holds.else_holds:
        return False
    return known_of_others(problem.model, set(problem.campaign.files.values()))


def forgotten(given: Model, result: FitResult) -> Sentence | None:
    """What a model knew much better than a fit that does not count it; None where nothing."""
    files = set(result.problem.campaign.files.values())
    if not known_of_others(given, files):
        return None
    before = {t.effect: t.values for t in given.terms}
    worst: tuple[float, str] = (_MUCH, "")
    for i, term in enumerate(result.model.terms):
        for unknown in result.problem.layout.unknowns[result.problem.layout.terms[i]]:
            was = before.get(term.effect, {}).get(unknown.name)
            now = term.values[unknown.name]
            if was is None or not was.measured or not was.sd or not now.sd:
                continue
            if now.sd > worst[0] * was.sd:
                unit, factor = read_in(unknown)
                named = said(
                    "{effect}: {name} was known to ± {before} {unit}, and is ± {after} now",
                    effect=term.effect.spec,
                    name=unknown.name,
                    before=in_digits(was.sd * factor, 2),
                    after=in_digits(now.sd * factor, 2),
                    unit=unit,
                )
                worst = (now.sd / was.sd, named)
    if not worst[1]:
        return None
    return said(
        "FORGOTTEN: other campaigns showed more than this one does ({what}). With --renew what "
        "they showed counts, too",
        what=worst[1],
    )


def accused(given: Model, first: FitResult, last: FitResult) -> tuple[Effect, ...]:
    """What has changed of which a model has no effect, as a thermometer; none that came since.

    Parameters as of `renew`.
    """
    if last.model.effects != given.effects:
        return ()
    holds = standing(given, first.thin)
    if holds is None or holds.suspicions or not holds.else_holds:
        return ()
    return tuple(c.effect for c in holds.changes if c.effect is not c.own)


def renewed_where_known(given: Model, first: FitResult, last: FitResult) -> FitResult:
    """As `renew`; the fit as it is where nothing was known, or too much has changed."""
    try:
        return renew(given, first, last)
    except NotRenewedError:
        return last


def renew(given: Model, first: FitResult, last: FitResult) -> FitResult:
    """A fit to a later campaign, with what was known before of all that has not changed.

    Parameters
    ----------
    given
        The model as it was, with values and covariance.
    first
        Its effects fitted to the later campaign.
    last
        The fit to renew: `first`, or one of more effects.

    Raises
    ------
    NotRenewedError
        In words: where nothing was known, where the campaign is one of those that the model was
        fitted to, or where more has changed than some of its effects.
    """
    campaign = first.problem.campaign
    if given.covariance is None or not all(t.fitted for t in given.terms) or not given.terms:
        raise NotRenewedError(
            said(
                "the model has no values with their covariance that could be renewed: fit it "
                "without --renew"
            )
        )
    files = set(campaign.files.values())
    variance = _renewed_with(given, files)
    if variance is not None:
        return renewed(last, given, (), variance, first)
    if given.fitted_to & files:
        raise NotRenewedError(
            said(
                "the model was fitted to this campaign already, which would count twice: renew "
                "the model as it was before"
            )
        )
    thin = first.thin
    more = [i for i, e in enumerate(last.model.effects) if e not in given.effects]
    layout = last.problem.layout
    beside = [
        thin.effect_columns(last.model.effects[i], layout.nonlinear_values(i, last.theta))
        for i in more
    ]
    holds = standing(given, thin, beside)
    if holds is None or holds.suspicions or not holds.else_holds:
        raise NotRenewedError(_why(holds))
    return renewed(last, given, [c.own for c in holds.changes], holds.variance)


def _why(holds: Standing | None) -> str:
    if holds is not None and holds.suspicions:
        return joined(holds.suspicions, "; ")
    return said(
        "more than some effects of the model has changed, or something is missing in it: see "
        "'abbe diagnose'; fit the whole model again, without --renew"
    )
