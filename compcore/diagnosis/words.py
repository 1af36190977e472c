"""A diagnosis in words; lengths in µm, or angles in µrad where there is nothing else."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from abbe.compcore.campaign.noise import NoiseFloor
from abbe.compcore.diagnosis.explain import changed, description, explanation, formula
from abbe.compcore.diagnosis.findings import Findings
from abbe.compcore.diagnosis.next_measurement.measure_next import Advice

_SAID = {
    "complete": "complete: the residuals are noise; this campaign shows nothing that is missing.",
    "missing": "missing: {0}.",
    "changed": "changed: the model as it was given does not hold on this campaign.",
    "unexplained": "unexplained: there is structure left that no effect of the catalogue explains.",
}


NO_CLOCK = (
    "the campaign says no times: nothing was looked for that changes with time (drift, warm-up, "
    "an event, a lag, an oscillation)"
)
"""Said of a campaign whose rows say not when they were measured."""


_MORE_THAN_NOISE = (
    "complete: no cause can be established; but what is left is more than {1} "
    "(χ² per degree of freedom {0:.3g}): too few independent rows, or {2}."
)


def noise_of(diagnosis: Findings, noise: NoiseFloor) -> float | None:
    """The noise of the quantity in which residuals are stated, mm or rad."""
    if diagnosis.of_rotations:
        return noise.value("rotation")
    level = noise.lengths
    return None if level is None else level.value


NO_UNCERTAINTY = (
    "no uncertainty of the rows is stated (a column sd), so how near this is to noise is judged by "
    "how well left-out blocks are predicted"
)


def uncertainty_stated(diagnosis: Findings) -> bool:
    """Whether any row says how sure it is: without that χ² is 1 by construction."""
    return bool(np.isfinite(diagnosis.whole.problem.campaign.sd).any())


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
    yield (
        f"residuals: {diagnosis.rms * factor:.2f} {unit} rms, "
        + (
            f"noise floor {floor * factor:.2f} {unit}"
            if floor is not None
            else "noise floor unknown (no repeats)"
        )
        + (
            f"; χ² per degree of freedom {diagnosis.whole.chi2_per_dof:.3f}"
            if uncertainty_stated(diagnosis)
            else f"; {NO_UNCERTAINTY}"
        )
    )
    if diagnosis.result is not diagnosis.whole:
        yield thinned_words(diagnosis)
    if not diagnosis.whole.problem.campaign.clocked:
        yield NO_CLOCK
    names = " and ".join(e.found.candidate.effect.spec for e in diagnosis.established)
    if diagnosis.verdict == "complete" and diagnosis.whole.misfit:
        said = (
            ("the stated uncertainty", "it was stated too small")
            if uncertainty_stated(diagnosis)
            else ("the scatter of repeated readings", "these were taken in too short a time")
        )
        yield _MORE_THAN_NOISE.format(diagnosis.whole.chi2_per_dof, *said)
    else:
        yield _SAID[diagnosis.verdict].format(names)
    if diagnosis.verdict == "changed" and diagnosis.standing is not None:
        for line in changed(diagnosis.standing):
            yield f"   {line}"
        yield f"   the new values: fit the model to this campaign: {fitting}"
        if names:
            yield f"missing besides: {names}."
    for i, established in enumerate(diagnosis.established, start=1):
        yield ""
        yield f"{i}. {established.found.candidate.effect.spec}"
        yield "   " + explanation(established, diagnosis)
        yield f"   add it: {adding(established.found.candidate.effect.spec)}"
    for structure in diagnosis.structure:
        yield ""
        yield f"structure: {description(structure)}"
        if spec := formula(structure):
            yield f"   empirical, describes without explaining: {adding(spec)}"
    if advice:
        yield ""
        yield "what to measure next:"
        for a in advice:
            yield "  - " + advice_text(a)


def thinned_words(diagnosis: Findings) -> str:
    """On how many rows of a large campaign causes were told apart."""
    n, some = diagnosis.whole.problem.n, diagnosis.result.problem.n
    return (
        f"causes were told apart on {some} of {n} rows, evenly from every set-up; evidence and "
        "parameters of what was found are those of all rows"
    )


def advice_text(advice: Advice) -> str:
    """One piece of advice as a line."""
    if advice.separates is not None:
        return (
            f"{advice.what}: tells it from '{advice.separates}' with χ² {advice.separation:.0f} "
            f"(now {advice.separation_now:.1f}; 14 is certain)"
        )
    return f"{advice.what}: the model's uncertainty falls by {advice.uncertainty_falls_by:.0%}"
