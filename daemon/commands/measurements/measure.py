"""``abbe measure``: a plan measured, target by target, into a campaign."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abbe.daemon.arguments.measurements.plan_reading import OnlySetups, PlanFile
from abbe.daemon.arguments.options import ActiveModel, ConfigFile, PrintedIn

if TYPE_CHECKING:
    from abbe.daemon.measure.events import Tell


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("measure")(measure)


def measure(
    plan: PlanFile,
    config: ConfigFile,
    out: Annotated[
        Path, typer.Option("-o", "--out", help="The campaign; gone on with where it is there.",
                           metavar="CAMPAIGN.csv")
    ],
    setup: OnlySetups = None,
    yes: Annotated[
        bool,
        typer.Option("--yes", help="Nobody is asked: set-ups count as set up when the machine "
                     "comes to their first target."),
    ] = False,
    once: Annotated[
        bool, typer.Option("--once", help="Do not wait for what was missed to be driven to again.")
    ] = False,
    active: ActiveModel = None,
    language: PrintedIn = "en",
    as_json: Annotated[
        bool, typer.Option("--json", help="One JSON object an event on standard output.")
    ] = False,
) -> None:  # fmt: skip
    """Follow the machine through a plan, read the instrument at every target, keep every row.

    Nothing is written to the controller. Ctrl-C ends; the same command goes on after the last row.
    An example: abbe measure plan.toml cmm.toml -o campaign.csv
    """
    from abbe.compcore.errors import AbbeError
    from abbe.compcore.sentences import said
    from abbe.daemon.measure.person import somebody_there
    from abbe.daemon.measure.show import telling
    from abbe.daemon.printed_in import failing_in
    from abbe.daemon.report.language import language as known_language

    spoken = known_language(language)
    with failing_in(spoken):
        if not yes and (as_json or not somebody_there()):
            raise AbbeError(
                said(
                    "nobody can be asked when an instrument is set up (no terminal, or --json): "
                    "say --yes"
                )
            )
    with failing_in(spoken), telling(as_json=as_json, say=spoken.say) as tell:
        run(plan, config, out, tuple(setup or ()), tell, yes=yes, once=once, active=active)


def run(
    plan: Path,
    config: Path,
    out: Path,
    names: tuple[str, ...],
    tell: Tell,
    *,
    yes: bool,
    once: bool,
    active: Path | None = None,
    conditions: Mapping[str, str] | None = None,
) -> None:
    """Measure a plan, as the command does.

    Parameters
    ----------
    conditions
        What the campaign's head says beside those of the configuration, which count before these.

    Raises
    ------
    InputError
        For bad files, and a campaign that was begun with others.
    AbbeError
        When it ended before all was measured: what is missing.
    """
    import asyncio

    from abbe.daemon.measure.beginning import begun
    from abbe.daemon.measure.ending import missing_words, run_until_ended

    with begun(plan, config, out, names, tell, yes=yes, once=once, active=active,
               conditions=conditions) as measurement:  # fmt: skip
        asyncio.run(run_until_ended(measurement))
        missing_words(measurement, tell, once=once)
