"""A model's next version: refitted, its error before and after, also on campaigns not fitted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from abbe.compcore.campaign.campaign import Campaign, Kind
from abbe.compcore.campaign.noise import NoiseFloor, noise_floor
from abbe.compcore.comparison.compare import compare
from abbe.compcore.comparison.read_again import ReadAgain, read_again
from abbe.compcore.diagnosis.findings import measured_kinds
from abbe.compcore.diagnosis.renewing import renew as known_before
from abbe.compcore.diagnosis.renewing import renewed_where_known
from abbe.compcore.effects import RotaryLocation, SpindleLocation
from abbe.compcore.effects.base import Effect, NonlinearParameter, Parameter
from abbe.compcore.errors import FitError
from abbe.compcore.files.campaign_file import require_signals
from abbe.compcore.files.model_file import save_model, summary
from abbe.compcore.files.model_toml.campaign_record import campaign_records, noise_by_file
from abbe.compcore.files.model_toml.fit_record import recorded
from abbe.compcore.fitting.cautious import cautiously
from abbe.compcore.fitting.fit import FitResult, fit
from abbe.compcore.model.as_built import reversed_parameters
from abbe.compcore.model.held_spindle import held_spindle, tool_of
from abbe.compcore.model.model import Model, Value
from abbe.compcore.model.to_enter import average_line_words
from abbe.compcore.model.told import not_told, untold
from abbe.compcore.sentences import said
from abbe.compcore.units import in_digits, read_in, with_uncertainty
from abbe.daemon.answers import as_built
from abbe.daemon.answers.inputs import now
from abbe.daemon.answers.model.fit import finite
from abbe.daemon.answers.model.held_out import HeldOutCampaigns, read_held_out, shares
from abbe.daemon.installed import abbe_version

Renewing = Literal["never", "where it can", "always"]
"""Whether what a model knew before counts beside another campaign."""

_RISEN = 1.005
_ROUNDING = 1e-3
"""χ² of a model with more effects may stand above that without by this part, and this much a row:
kinds of rows whose uncertainties come from residuals are weighed anew, and what is not determined
is left where it is believable."""

NOT_FALLEN = 0.995
"""A held-out error above this part of the one before has not fallen."""


@dataclass(frozen=True, eq=False)
class Revision:
    """Two versions of a model on the same measurements.

    Attributes
    ----------
    model
        The new version, as written, with its record.
    before, after
        The fits.
    noise
        The campaign's noise floor.
    holdout_before, holdout_after
        RMS of displacement residuals on campaigns that were not fitted, mm; None without any.
    held_out
        Those campaigns, with what they share with the fitted ones.
    again
        What they leave where the fitted ones were read, too; None where that says nothing.
    """

    model: Model
    before: FitResult
    after: FitResult
    noise: NoiseFloor
    holdout_before: float | None
    holdout_after: float | None
    held_out: HeldOutCampaigns | None = None
    again: ReadAgain | None = None


def revise(
    old: Model,
    new: Model,
    campaign: Campaign,
    holdout: Sequence[Path],
    out: Path,
    *,
    added: str | None = None,
    removed: str | None = None,
    robust: bool = False,
    renew: Renewing = "never",
    progress: Callable[[str], None] = lambda _: None,
) -> Revision:
    """Fit both versions, lay them beside unseen campaigns, write the new one.

    With `robust` rows that do not belong to the others are set aside in both fits. A model whose
    values are cautious (`fitting.cautious`) keeps to that. With `renew` what the old model knew
    from other campaigns counts beside this one, but for what has changed.

    Raises
    ------
    InputError
        For bad campaigns; nothing is written then.
    NotRenewedError
        Where what was known before cannot count, and has to.
    """
    held = read_held_out(holdout, old.machine, campaign)
    unseen = None if held is None else held.campaign
    if unseen is not None:
        require_signals(unseen, new)
        require_signals(unseen, old)
    require_signals(campaign, new)
    progress("fitting the model as it is")
    before = fit(old, campaign, robust=robust)
    progress("fitting the next version")
    after = fit(_from(before.model, new), campaign, robust=robust)
    require_no_worse(before, after)
    if renew == "always":
        before, after = known_before(old, before, before), known_before(old, before, after)
    elif renew == "where it can":
        after = renewed_where_known(old, before, after)
        before = before if after.renewal is None else renewed_where_known(old, before, before)
    if old.fit.get("cautious") and after.renewal is None:
        before, after = cautiously(before), cautiously(after)
    noise = noise_floor(campaign, old.machine)
    lengths = noise.lengths
    record: dict[str, Any] = {
        "date": now(),
        "version": abbe_version(),
        "noise_floor": None if lengths is None else lengths.value,
        "noise_floor_rotation": noise.value("rotation"),
        "noise": noise_by_file(campaign, old.machine, noise),
    }
    # a model that was never fitted would leave no error from which to fall
    ancestor = old if old.fit else recorded(before, old, **record)
    named = {"added": added, "removed": removed}
    extra: dict[str, Any] = {k: v for k, v in named.items() if v is not None}
    errors: tuple[float, float] | None = None
    again: ReadAgain | None = None
    if unseen is not None:
        progress("campaigns that are not fitted")
        beside = [compare(r.model, unseen) for r in (before, after)]
        rotations = measured_kinds(before) == (Kind.ROTATION,)
        parts = [c.rotations if rotations else c.lengths for c in beside]
        errors = (parts[0].rms, parts[1].rms)
        again = read_again(after, beside[1], rotations=rotations)
        repeats = noise_by_file(unseen, old.machine)
        first, last = (
            {"holdout": campaign_records(unseen, c.residual, repeats)}
            | ({"holdout_rms": c.lengths.rms * 1e3} if c.lengths.n else {})
            for c in beside
        )
        extra |= last
        if _fitted_to(ancestor, campaign) and "holdout" not in ancestor.fit:
            ancestor = replace(ancestor, fit={**ancestor.fit, **first})
    kept = recorded(after, ancestor, **record)
    written = replace(kept, fit={**kept.fit, **extra})
    save_model(written, out)
    was, became = errors or (None, None)
    return Revision(written, before, after, noise, was, became, held, again)


def _from(fitted: Model, new: Model) -> Model:
    """The next version with the values that its effects have in this one, where to begin."""
    values = {term.effect: term.values for term in fitted.terms}
    terms = tuple(replace(t, values=values.get(t.effect, t.values)) for t in new.terms)
    return replace(new, terms=terms)


def require_no_worse(before: FitResult, after: FitResult) -> None:
    """Refuse a model with more effects that fits worse than without: least squares cannot.

    Raises
    ------
    FitError
        Where χ² rose, both in the uncertainties of the first fit.
    """
    if not set(before.model.effects) <= set(after.model.effects):
        return
    # what one of them set aside says nothing of the other
    weight = np.where(after.problem.weight > 0.0, before.problem.weight, 0.0)
    one, two = (float(np.sum((r.residual * weight) ** 2)) for r in (before, after))
    if two > _RISEN * one + _ROUNDING * before.problem.n:
        raise FitError(
            f"χ² rose from {one:.6g} to {two:.6g} although the model has one effect more: that is "
            "a mistake of Abbe's fit, not of the campaign. Nothing is written; please report it "
            "with the model and the campaign"
        )


def _fitted_to(model: Model, campaign: Campaign) -> bool:
    """Whether the model's record is of the very files of a campaign."""
    fitted = {c.get("sha256") for c in model.fit.get("campaigns", ())}
    return fitted == set(campaign.files.values())


def unfitted(old: Model, new: Model, *, removed: str) -> Model:
    """The next version without a refit, its ancestor's record in the history."""
    history = (*new.history, summary(old)) if old.fit else new.history
    return replace(
        new, fit={"date": now(), "removed": removed, "abbe": abbe_version()}, history=history
    )


def as_json(revision: Revision, effect: Effect | None) -> dict[str, Any]:
    """One object for ``add --json``; µm, or µrad where there are rotations only (`unit`)."""
    was, became, floor, rotations = _errors(revision)
    factor = 1e6 if rotations else 1e3
    out: dict[str, Any] = {
        "unit": "urad" if rotations else "um",
        "rms_before": finite(was, factor),
        "rms_after": finite(became, factor),
        "noise_floor": None if floor is None else floor * factor,
        "holdout_before": _in(revision.holdout_before, factor),
        "holdout_after": _in(revision.holdout_after, factor),
        "holdout_shares": shares(revision.held_out),
        "chi2_per_dof_before": finite(revision.before.chi2_per_dof),
        "chi2_per_dof_after": finite(revision.after.chi2_per_dof),
    }
    if effect is not None:
        out["parameters"] = {
            p.name: {"value": v.value, "sd": v.sd, "unit": p.unit, "measured": v.measured}
            for p, v in _parameters(revision.after, effect)
        }
        model = revision.after.model
        values = next((t.values for t in model.terms if t.effect == effect), {})
        out["on_the_table"] = as_built.seen_json(model.machine, effect, values)
        out["rotary_axes"] = as_built.lines_json(model)
        tool = tool_of(revision.after.problem.campaign)
        out["spindle"] = as_built.spindle_json(held_spindle(model, tool))
    return out


def as_text(revision: Revision, effect: Effect | None) -> Iterator[str]:
    """Lines for people: parameters, the error before and after, a warning where it did not fall."""
    if effect is not None:
        nothing = untold(effect, revision.after.model.machine)
        for p, found in _parameters(revision.after, effect):
            if not_told(found, nothing.get(p.name, 0.0)):
                yield said("{name} not measured", name=p.name)
                continue
            shown, factor = read_in(p)
            wide = None if found.sd is None else found.sd * factor
            text = f"{p.name} = {with_uncertainty(found.value * factor, wide)} {shown}"
            if p.name in reversed_parameters(revision.after.model.machine, effect):
                there = in_digits(-found.value * factor, 4, sign=True)
                text = said(
                    "{value} (on the table itself {there})", value=text, there=f"{there} {shown}"
                )
            yield text
        if isinstance(effect, RotaryLocation | SpindleLocation):
            tool = tool_of(revision.after.problem.campaign)
            yield from average_line_words(revision.after.model, tool)
    was, became, floor, rotations = _errors(revision)
    unit, factor = ("µrad", 1e6) if rotations else ("µm", 1e3)
    at_best = (
        said("; noise floor {floor} {unit}", floor=f"{floor * factor:.2f}", unit=unit)
        if floor is not None
        else ""
    )
    yield said(
        "fitted campaigns: {one} → {two} {unit} rms{floor}; χ² per degree of freedom {before} → "
        "{after}",
        one=f"{was * factor:.3f}",
        two=f"{became * factor:.3f}",
        unit=unit,
        floor=at_best,
        before=f"{revision.before.chi2_per_dof:.3f}",
        after=f"{revision.after.chi2_per_dof:.3f}",
    )
    one, two = revision.holdout_before, revision.holdout_after
    if one is None or two is None:
        yield said(
            "no campaign was held out: whether measurements that were not fitted agree is not known"
        )
        return
    if revision.held_out is not None:
        yield from revision.held_out.notes()
    yield said(
        "held-out campaigns: {one} → {two} {unit} rms",
        one=f"{one * factor:.3f}",
        two=f"{two * factor:.3f}",
        unit=unit,
    )
    if revision.again is not None:
        yield from revision.again.words()
    if effect is not None and two > NOT_FALLEN * one:
        yield said(
            "WARNING: the held-out error did not fall. The effect explains the fitted campaign and "
            "predicts nothing; do not use it for compensation before you know why."
        )


def _errors(revision: Revision) -> tuple[float, float, float | None, bool]:
    """RMS before and after and the noise floor, mm or rad, and whether they are of rotations."""
    kinds = measured_kinds(revision.before)
    rotations = kinds == (Kind.ROTATION,)
    lengths = revision.noise.lengths
    level = None if lengths is None else lengths.value
    floor = revision.noise.value("rotation") if rotations else level
    return revision.before.rms(*kinds), revision.after.rms(*kinds), floor, rotations


def _in(value: float | None, factor: float) -> float | None:
    return None if value is None else finite(value, factor)


def _parameters(
    result: FitResult, effect: Effect
) -> Iterator[tuple[Parameter | NonlinearParameter, Value]]:
    machine = result.model.machine
    both: tuple[Parameter | NonlinearParameter, ...]
    both = (*effect.linear(machine), *effect.nonlinear(machine))
    known = {p.name: p for p in both}
    for term in result.model.terms:
        if term.effect == effect:
            for name, value in term.values.items():
                yield known[name], value
