"""The page of ``abbe plan``: a list to be taken to the machine."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from abbe.compcore.campaign.plan import PlannedMeasurement
from abbe.compcore.machine.machine import Machine
from abbe.compcore.sentences import joined, said
from abbe.daemon.answers.measurements.plan import AFTER, BEFORE, standing_words, steps_words
from abbe.daemon.report.head import PageHead, facts_before, file_on_page
from abbe.daemon.report.language import PageLanguage
from abbe.daemon.report.page import Page


def page(
    machine: Machine,
    plan: Sequence[PlannedMeasurement],
    model: Path,
    language: PageLanguage | None = None,
) -> Page:
    """Lay out a plan, in English or another language."""
    head = PageHead(facts_before(machine), [file_on_page("model", model)])
    name = machine.name or said("this machine")
    made = Page(said("Measurements of {machine}", machine=name), head=head, language=language)
    code = machine.structure
    made.text(said("{structure}, in the order of ISO/TR 16907, 10.3.", structure=code))
    signals = ", ".join(machine.signals)
    record = [said("record with every reading: {signals}", signals=signals)] if signals else []
    made.notes([*BEFORE, *record])
    made.table(
        ["", said("Axis"), said("What"), said("Gives"), said("With"), said("Targets"), said("Runs"),
         said("Other axes at"), said("Done")],
        [
            [
                i,
                p.axis,
                p.what,
                joined(p.motions, ", "),
                p.instrument,
                joined(list(map(steps_words, p.steps)), " / ") or "–",
                p.runs if p.steps else None,
                standing_words(p),
                "",
            ]
            for i, p in enumerate(plan, start=1)
        ],
    )  # fmt: skip
    made.notes([AFTER])
    return made
