"""The page of ``abbe diagnose --report``: how wrong, where, why, what else, what to do."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from abbe.compcore.campaign.noise import NoiseFloor
from abbe.compcore.diagnosis.campaign_notes import campaign_notes
from abbe.compcore.diagnosis.explain import (
    changed,
    description,
    explanation,
    formula,
    headline,
)
from abbe.compcore.diagnosis.findings import Established
from abbe.compcore.diagnosis.next_measurement.measure_next import Advice
from abbe.compcore.diagnosis.pictures import CANDIDATES, IN_VOLUME, ON_LINE, OVER_TIME
from abbe.compcore.diagnosis.shop_words import in_the_shop
from abbe.compcore.diagnosis.uncatalogued.residual_pattern import ResidualPattern
from abbe.compcore.diagnosis.verdict import Diagnosis
from abbe.compcore.diagnosis.words import (
    MEND_FIRST,
    NO_UNCERTAINTY,
    advice_text,
    alone_words,
    described,
    described_words,
    noise_of,
    suspicious,
    thinned_words,
    uncertainty_stated,
)
from abbe.compcore.figures.figure import Figure
from abbe.compcore.sentences import Sentence, said
from abbe.compcore.units import in_digits
from abbe.daemon.answers.model.apply import StepFigures
from abbe.daemon.answers.typed import Adding
from abbe.daemon.report.head import PageHead
from abbe.daemon.report.model.cause_parameters import largest_of, parameter_rows
from abbe.daemon.report.model.steps import how_it_fell
from abbe.daemon.report.page import Page, number

F64 = NDArray[np.float64]

TITLES = {
    "complete": said("Nothing is missing"),
    "missing": said("A cause is missing"),
    "changed": said("The machine has changed"),
    "unexplained": said("Something is left that no effect of the catalogue explains"),
}


MORE_THAN_NOISE = said("More than noise is left, of which no cause can be established")
"""Title of a model that the catalogue adds nothing to, and that leaves more than was stated."""

DESCRIBED = said("Nothing more is missing; part of it is described, not explained")
"""Title of a model that leaves noise because formulas describe the rest."""


def page(
    diagnosis: Diagnosis,
    noise: NoiseFloor,
    advice: Sequence[Advice],
    head: PageHead,
    adding: Adding,
    steps: Sequence[StepFigures] = (),
) -> Page:
    """The whole story on one page; with the `steps` of ``--apply`` also how the error fell."""
    machine = diagnosis.whole.problem.model.machine
    title, verdict = verdict_title(diagnosis), _title(diagnosis)
    name = machine.name or "Machine"
    out = Page(title, name if title == verdict else f"{name}: {verdict}", head)
    out.notes([f"SUSPICIOUS: {what}" for what in suspicious(diagnosis)], warning=True)
    if diagnosis.verdict == "changed" and diagnosis.standing is not None:
        out.section("What has changed")
        out.notes(list(changed(diagnosis.standing)))
    _how_wrong(out, diagnosis, noise)
    if len(steps) > 1:
        how_it_fell(out, steps)
    figures = diagnosis.figures()
    _where(out, figures)
    if diagnosis.established:
        _why(out, diagnosis, figures)
    if diagnosis.structure:
        _structure(out, diagnosis, adding, figures)
    _candidates(out, diagnosis, figures)
    _what_to_do(out, diagnosis, advice, adding)
    return out


def verdict_title(diagnosis: Diagnosis) -> Sentence:
    """What the reader came for, in the shop's words."""
    if diagnosis.verdict == "changed" and diagnosis.standing is not None:
        change = diagnosis.standing.changes[:1]
        if change:
            unit, factor = ("µrad", 1e6) if change[0].of_rotations else ("µm", 1e3)
            by = [(p.by, p.unit) for p in change[0].parameters]
            structure = diagnosis.whole.problem.model.machine.structure
            what = in_the_shop(
                change[0].effect, change[0].largest * factor, unit, by,
                structure.upright, structure.jointed,
            )  # fmt: skip
            return said("It has changed: {what}", what=what.within())
    if diagnosis.established:
        return said_in_the_shop(diagnosis, diagnosis.established[0])
    return _title(diagnosis)


def _title(diagnosis: Diagnosis) -> Sentence:
    """The verdict's title; that nothing is missing is not said where more than noise is left."""
    if diagnosis.verdict == "complete" and diagnosis.whole.misfit:
        return MORE_THAN_NOISE
    if diagnosis.verdict == "complete" and described(diagnosis):
        return DESCRIBED
    return TITLES[diagnosis.verdict]


def said_in_the_shop(diagnosis: Diagnosis, established: Established) -> Sentence:
    """A cause in the shop's words, with the largest error of it that the campaign shows."""
    unit, _, factor = diagnosis.unit
    largest = largest_of(diagnosis, established, rotations=diagnosis.of_rotations) * factor
    values = [(e.value, e.unit) for e in established.estimates if e.measured]
    structure = diagnosis.result.problem.model.machine.structure
    return in_the_shop(
        established.effect, largest, unit, values, structure.upright, structure.jointed
    )


def _how_wrong(out: Page, diagnosis: Diagnosis, noise: NoiseFloor) -> None:
    level = noise_of(diagnosis, noise)
    unit, _, factor = diagnosis.unit
    value = "unknown" if level is None else number(level * factor, 3)
    figures = [
        ("residuals", number(diagnosis.rms * factor, 3), f"{unit} rms"),
        ("noise floor", value, "" if level is None else unit),
    ]
    stated = uncertainty_stated(diagnosis)
    whole = diagnosis.whole.chi2_per_dof
    if stated:
        figures.append(("χ² per degree of freedom", number(whole, 3), ""))
    if diagnosis.established:
        last = number(diagnosis.left, 3) if stated else f"{diagnosis.left / whole:.2%}"
        figures.append(("… once the causes are added", last, "" if stated else "of the variance"))
    out.section("How wrong")
    out.key_figures(figures)
    out.text(
        "χ² per degree of freedom compares the residuals with the stated uncertainty of each row; "
        "1 means that nothing but noise is left."
        if stated
        else NO_UNCERTAINTY[0].upper() + NO_UNCERTAINTY[1:] + "."
    )
    out.notes(list(campaign_notes(diagnosis)))
    if diagnosis.strays:
        out.text(alone_words(diagnosis))
        out.notes([s.text for s in diagnosis.strays])
    if diagnosis.result is not diagnosis.whole:
        out.text(f"Pictures show those rows only: {thinned_words(diagnosis)}.")


def _where(out: Page, figures: Mapping[str, Callable[[], Figure]]) -> None:
    if not {ON_LINE, IN_VOLUME, OVER_TIME} & set(figures):
        return
    out.section("Where")
    if ON_LINE in figures:
        out.figure(figures[ON_LINE](), "Residuals along the one line on which all places lie.")
    if IN_VOLUME in figures:
        out.figure(
            figures[IN_VOLUME](),
            "Residuals in the volume: each line points along the measured direction and is as long "
            "as the residual, enlarged. Turn the picture with the mouse.",
        )
    if OVER_TIME in figures:
        out.figure(
            figures[OVER_TIME](),
            "Residuals over time, by measured direction: a slope or a wave in time is no noise.",
        )


def _why(out: Page, diagnosis: Diagnosis, figures: Mapping[str, Callable[[], Figure]]) -> None:
    out.section("Why")
    for i, established in enumerate(diagnosis.established, start=1):
        effect = established.found.candidate.effect
        out.subsection(f"{i}. {said_in_the_shop(diagnosis, established)}", effect.spec)
        out.text(explanation(established, diagnosis))
        out.table(
            ["parameter", "fitted", "plausible", "what it is"],
            parameter_rows(diagnosis, established),
        )
        spec = effect.spec
        others = ", and with the other causes," if len(diagnosis.established) > 1 else ""
        out.figure(
            figures[f"cause {i}"](),
            f"Residuals of the model without '{spec}'{others} against what it would add. Means on "
            "the dashed line: it explains them.",
        )


def structure_words(structure: ResidualPattern, diagnosis: Diagnosis) -> Sentence:
    """What no cause explains, in two sentences."""
    share = structure.drop / diagnosis.basis.chi2
    return said(
        "What is left goes like this: {what}. It makes up {share} % of the residuals' χ²; depends "
        "on {variables}.",
        what=description(structure),
        share=in_digits(100.0 * share, 2),
        variables=", ".join(structure.depends_on),
    )


def _structure(
    out: Page,
    diagnosis: Diagnosis,
    adding: Adding,
    figures: Mapping[str, Callable[[], Figure]],
) -> None:
    out.section("What no cause explains")
    for i, s in enumerate(diagnosis.structure, start=1):
        out.text(structure_words(s, diagnosis))
        out.figure(
            figures[f"structure {i}"](),
            "Residuals of the model as it is against what this describes. Means on the dashed "
            "line: it says all of it.",
        )
        if spec := formula(s):
            out.notes([f"Empirical, describes without explaining: {adding.command(spec)}"])


def _candidates(
    out: Page, diagnosis: Diagnosis, figures: Mapping[str, Callable[[], Figure]]
) -> None:
    if CANDIDATES not in figures:
        return
    out.section("What else it could be")
    out.text(
        f"{diagnosis.tests} candidates were tested at once. Evidence is in units of "
        "−2·ln(likelihood), after the price of each coefficient: 12 is convincing, a lead of 10 "
        "over the next is a clear distinction."
    )
    out.figure(figures[CANDIDATES](), "The strongest single candidates against the model as it is.")
    for established in diagnosis.established:
        if not established.aliases:
            continue
        out.subsection(f"not to be distinguished from '{established.found.candidate.effect.spec}'")
        out.table(
            ["candidate", "what it is", "χ² that tells them apart (14 is certain)"],
            [
                [
                    a.found.candidate.effect.spec,
                    headline(a.found.candidate.effect),
                    float(a.separation),
                ]
                for a in established.aliases[:10]
            ],
            digits=3,
        )


def _what_to_do(out: Page, diagnosis: Diagnosis, advice: Sequence[Advice], adding: Adding) -> None:
    out.section("What to do")
    if diagnosis.standing is not None and diagnosis.standing.suspicions:
        out.text(f"{MEND_FIRST[0].upper()}{MEND_FIRST[1:]}.")
    elif diagnosis.verdict == "changed":
        out.text("Find out what happened to the machine. The model's new values:")
        out.notes([adding.fitting])
    if diagnosis.established:
        first = diagnosis.established[0].found.candidate.effect.spec
        out.text(
            "Add the first cause, look whether campaigns that were not fitted agree (with "
            "--holdout and the file of one), and diagnose again:"
        )
        out.notes([adding.command(first)])
    elif diagnosis.structure:
        out.text(
            "Look for the physics behind what is described above: what was switched, moved, heated "
            "or loaded in that rhythm? Record it as a signal and measure again."
        )
    elif parts := described(diagnosis):
        out.text(described_words(parts))
    elif diagnosis.verdict != "changed":
        out.text("Nothing. The model explains these measurements down to their noise.")
    if advice:
        out.subsection("what to measure next")
        out.notes([advice_text(a) for a in advice])
