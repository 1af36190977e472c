"""A diagnosis in words; lengths in µm, or angles in µrad where there is nothing else."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from abbe.compcore.campaign.noise import NoiseFloor
from abbe.compcore.campaign.suspicions import of_campaign, of_chi2, of_signals, of_values
from abbe.compcore.diagnosis.campaign_notes import campaign_notes
from abbe.compcore.diagnosis.disagreeing import disagreeing
from abbe.compcore.diagnosis.explain import changed, description, explanation, formula
from abbe.compcore.diagnosis.findings import Findings
from abbe.compcore.diagnosis.hardly_noise import beyond_repeats, too_few_rows
from abbe.compcore.diagnosis.next_measurement.measure_next import Advice
from abbe.compcore.diagnosis.renewing import renews
from abbe.compcore.effects.catalogue.formula import Formula
from abbe.compcore.model.late_thermometers import late_thermometers
from abbe.compcore.sentences import Sentence, listed, said
from abbe.compcore.units import in_digits

_SAID = {
    "complete": said(
        "complete: the residuals are noise; this campaign shows nothing that is missing."
    ),
    "changed": said("changed: the model as it was given does not hold on this campaign."),
    "unexplained": said(
        "unexplained: there is structure left that no effect of the catalogue explains."
    ),
}


MOST_LISTED = 10
"""Readings that stand alone that are listed; the rest are counted."""


def noise_of(diagnosis: Findings, noise: NoiseFloor) -> float | None:
    """The noise of the quantity in which residuals are stated, mm or rad."""
    if diagnosis.of_rotations:
        return noise.value("rotation")
    level = noise.lengths
    return None if level is None else level.value


def why_unknown(diagnosis: Findings, noise: NoiseFloor) -> str:
    """Why `noise_of` is None."""
    level = noise.levels.get("rotation") if diagnosis.of_rotations else noise.lengths
    return level.reason if level is not None and level.reason else said("no repeats")


NO_UNCERTAINTY = said(
    "no uncertainty of the rows is stated (a column sd), so how near this is to noise is judged by "
    "how well left-out blocks are predicted"
)


def uncertainty_stated(diagnosis: Findings) -> bool:
    """Whether any row says how sure it is: without that χ² is 1 by construction."""
    return bool(np.isfinite(diagnosis.whole.problem.campaign.sd).any())


def judged(diagnosis: Findings, floor: float | None) -> bool:
    """Whether what is left can be held against anything: stated uncertainties, or repeats."""
    return uncertainty_stated(diagnosis) or floor is not None


LARGE_ANGLES = said(
    "angles as large as this do not add up: what else is missing is asked again once it is added. "
    "--apply composes errors in full from there on; in a model of your own write "
    'composition = "exact" into [machine] (or enter an encoder\'s zero in the controller)'
)
"""Said where a cause turns so far that what the lever rule leaves out is worth a cause."""


def diagnosis_words(
    diagnosis: Findings,
    noise: NoiseFloor,
    advice: Sequence[Advice],
    adding: Callable[[str], str],
    fitting: str = "abbe.fit(model, campaign)",
) -> Iterator[str]:
    """Lines for people: how wrong, what is missing and why, what else it could be, what to do.

    `adding` says how an effect is added, from its spec: what to type, or what to call; `fitting`
    how the model is fitted.
    """
    floor = noise_of(diagnosis, noise)
    unit, _, factor = diagnosis.unit
    for suspicion in suspicious(diagnosis):
        yield said("SUSPICIOUS: {what}", what=suspicion)
    if diagnosis.mistakes:
        yield MEND_FIRST
    yield said(
        "residuals: {rms} {unit} rms, {floor}; {noise}",
        rms=f"{diagnosis.rms * factor:.2f}",
        unit=unit,
        floor=said("noise floor {floor} {unit}", floor=f"{floor * factor:.2f}", unit=unit)
        if floor is not None
        else said("noise floor unknown ({reason})", reason=why_unknown(diagnosis, noise)),
        noise=said(
            "χ² per degree of freedom {chi2}", chi2=in_digits(diagnosis.whole.chi2_per_dof, 4)
        )
        if uncertainty_stated(diagnosis)
        else NO_UNCERTAINTY,
    )
    if diagnosis.result is not diagnosis.whole:
        yield thinned_words(diagnosis)
    yield from campaign_notes(diagnosis)
    if diagnosis.strays:
        yield alone_words(diagnosis)
        for stray in diagnosis.strays[:MOST_LISTED]:
            yield stray.text
        if len(diagnosis.strays) > MOST_LISTED:
            yield said("and {count} more readings", count=len(diagnosis.strays) - MOST_LISTED)
    names = listed([e.found.candidate.effect.spec for e in diagnosis.established])
    likely = too_few_rows(diagnosis, adding)
    if diagnosis.verdict == "complete" and diagnosis.whole.misfit:
        yield _more_than_noise(diagnosis)
    elif diagnosis.verdict == "complete" and beyond_repeats(diagnosis, noise):
        yield said(
            "complete: no further cause can be established; but what is left is more than the "
            "scatter of repeated readings ({floor} {unit}): too few independent rows, or these "
            "were taken in too short a time.",
            floor=f"{(floor or 0.0) * factor:.2f}",
            unit=unit,
        )
    elif diagnosis.verdict == "complete" and (parts := described(diagnosis)):
        yield said("complete: {what}", what=described_words(parts).within())
    elif diagnosis.verdict == "missing":
        yield said("missing: {names}.", names=names)
        if diagnosis.large_angles:
            yield LARGE_ANGLES
    elif likely is None and diagnosis.verdict == "complete" and not judged(diagnosis, floor):
        yield said(
            "complete: no further cause can be established. Whether what is left is noise this "
            "campaign cannot say: no uncertainty is stated, and nothing was read twice."
        )
    elif likely is None:
        yield _SAID[diagnosis.verdict]
    if likely is not None:
        yield likely
    if diagnosis.verdict == "changed" and diagnosis.standing is not None:
        for line in changed(diagnosis.standing):
            yield f"   {line}"
        if diagnosis.standing.suspicions:
            yield f"   {MEND_FIRST}"
        elif names and renews(diagnosis):
            yield said("   the new values come with what is missing, once that is added")
        elif outside := [c.effect for c in diagnosis.standing.changes if c.effect is not c.own]:
            for effect in outside:
                yield said("   add it: {how}", how=adding(effect.spec))
        else:
            yield said("   the new values: fit the model to this campaign: {how}", how=fitting)
        if names:
            yield said("missing besides: {names}.", names=names)
    yield from disagreeing(diagnosis)
    for i, established in enumerate(diagnosis.established, start=1):
        yield ""
        yield f"{i}. {established.found.candidate.effect.spec}"
        yield "   " + explanation(established, diagnosis)
        yield said("   add it: {how}", how=adding(established.found.candidate.effect.spec))
    for structure in diagnosis.structure:
        yield ""
        yield said("structure: {what}", what=description(structure))
        if spec := formula(structure):
            yield said("   empirical, describes without explaining: {how}", how=adding(spec))
    if advice:
        yield ""
        yield said("what to measure next:")
        for a in advice:
            yield "  - " + advice_text(a)


def suspicious(diagnosis: Findings) -> Iterator[str]:
    """A wrong unit or sense of an axis, or far less left than stated: said first of all."""
    whole = diagnosis.whole
    yield from (m.words for m in diagnosis.mistakes)
    found = {m.text for m in diagnosis.mistakes}
    others = of_campaign(whole.problem.campaign, whole.model.machine)
    yield from (s for s in others if s not in found)
    yield from late_thermometers(whole.model)
    if diagnosis.standing is None:
        # of a model with values the units are seen against what it predicts
        campaign = whole.problem.campaign
        yield from of_values(campaign, whole.seen(campaign.value))
        known = whole.problem.model.measured_signals
        yield from of_signals(campaign, whole.model.machine, known)
    if whole.chi2_per_dof < 1.0:
        yield from of_chi2(whole.chi2_per_dof, whole.dof, stated=uncertainty_stated(diagnosis))


MEND_FIRST = said(
    "put that right first, and diagnose again: a model that is fitted to such a campaign takes the "
    "mistake over"
)
"""Said in place of the command that fits where a sign or a unit is suspicious."""


def described(diagnosis: Findings) -> list[str]:
    """Of what the model describes the error by formulas: the directions, and the tilts' names."""
    channels = [e.channel for e in diagnosis.whole.model.effects if isinstance(e, Formula)]
    return list(dict.fromkeys(c[1:] if c.startswith("d") else c for c in channels))


def described_words(parts: Sequence[str]) -> Sentence:
    """That nothing more is missing, though formulas describe and explain nothing."""
    return said(
        "Nothing more is missing; part of the error ({parts}) is described by a formula, not "
        "explained: that holds inside what was measured, and does not say why.",
        parts=", ".join(parts),
    )


def _more_than_noise(diagnosis: Findings) -> Sentence:
    chi2 = in_digits(diagnosis.whole.chi2_per_dof)
    if uncertainty_stated(diagnosis):
        return said(
            "complete: no further cause can be established; but what is left is more than the "
            "stated uncertainty (χ² per degree of freedom {chi2}): too few independent rows, or it "
            "was stated too small.",
            chi2=chi2,
        )
    return said(
        "complete: no further cause can be established; but what is left is more than the scatter "
        "of repeated readings (χ² per degree of freedom {chi2}): too few independent rows, or "
        "these were taken in too short a time.",
        chi2=chi2,
    )


def alone_words(diagnosis: Findings) -> Sentence:
    """How many readings stand alone, and what to do about them."""
    count = len(diagnosis.strays)
    if count == 1:
        return said(
            "1 reading stands alone: nothing measured beside it agrees with it, so it was left out "
            "here. Look at it, measure it again; --robust leaves it out of a fit, too:"
        )
    return said(
        "{count} readings stand alone: nothing measured beside them agrees with them, so they were "
        "left out here. Look at them, measure them again; --robust leaves them out of a fit, too:",
        count=count,
    )


def thinned_words(diagnosis: Findings) -> Sentence:
    """On how many rows of a large campaign causes were told apart."""
    return said(
        "causes were told apart on {some} of {n} rows, evenly from every set-up; evidence and "
        "parameters of what was found are those of all rows",
        some=diagnosis.result.problem.n,
        n=diagnosis.whole.problem.n,
    )


def advice_text(advice: Advice) -> Sentence:
    """One piece of advice as a line."""
    if advice.separates is not None:
        return said(
            "{what}: tells '{cause}' from '{other}' with χ² {chi2} (now {now}; 14 is certain)",
            what=advice.what,
            cause=advice.cause or "",
            other=advice.separates,
            chi2=f"{advice.separation:.0f}",
            now=f"{advice.separation_now:.1f}",
        )
    return said(
        "{what}: the model's uncertainty falls by {share}",
        what=advice.what,
        share=f"{advice.uncertainty_falls_by:.0%}",
    )
