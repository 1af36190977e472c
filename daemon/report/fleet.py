"""The page of ``abbe fleet --report``: every machine of a plant on one page."""

from __future__ import annotations

from collections.abc import Sequence

from abbe.daemon.answers.fleet.overview import COLUMNS, MachineHealth, headline, rows
from abbe.daemon.report.page import Page


def fleet_page(found: Sequence[MachineHealth]) -> Page:
    """The whole page.

    Parameters
    ----------
    found
        The machines, those that need somebody first.
    """
    page = Page(headline(found), "the machines of a plant, as its store knows them")
    named = {
        "alarm": "with alarms", "attention": "to be looked at", "unknown": "silent",
        "good": "in order",
    }  # fmt: skip
    figures = [
        (words, str(sum(h.health == kind for h in found)), "") for kind, words in named.items()
    ]
    page.key_figures(figures)
    page.notes(
        [f"{h.machine.name} ({h.machine.site}): {alarm}" for h in found for alarm in h.alarms],
        warning=True,
    )
    page.section("Machines")
    page.table([c.capitalize() for c in COLUMNS], rows(found))
    return page
