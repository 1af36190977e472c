"""The page of ``abbe plan``: a list to be taken to the machine."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from abbe.compcore.campaign.plan import PlannedMeasurement
from abbe.compcore.machine.machine import Machine
from abbe.daemon.answers.measurements.plan import AFTER, BEFORE, standing_words, steps_words
from abbe.daemon.report.head import PageHead, facts_before, file_on_page
from abbe.daemon.report.page import Page


def page(machine: Machine, plan: Sequence[PlannedMeasurement], model: Path) -> Page:
    """Lay out a plan."""
    head = PageHead(facts_before(machine), [file_on_page("model", model)])
    made = Page(f"Measurements of {machine.name or 'this machine'}", head=head)
    made.text(f"{machine.structure}, in the order of ISO/TR 16907, 10.3.")
    record = [f"record with every reading: {', '.join(machine.signals)}"] if machine.signals else []
    made.notes([*BEFORE, *record])
    made.table(
        ["", "Axis", "What", "Gives", "With", "Targets", "Runs", "Other axes at", "Done"],
        [
            [
                i,
                p.axis,
                p.what,
                ", ".join(p.motions),
                p.instrument,
                " / ".join(map(steps_words, p.steps)) or "–",
                p.runs if p.steps else None,
                standing_words(p),
                "",
            ]
            for i, p in enumerate(plan, start=1)
        ],
    )
    made.notes([AFTER])
    return made
