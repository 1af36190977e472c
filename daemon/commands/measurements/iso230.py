"""``abbe iso230``: positioning by ISO 230-2, circles by ISO 230-4, diagonals by ISO 230-6."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.options import AsJson, Force, Report


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("iso230")(iso230)


def iso230(
    campaign: Annotated[Path, typer.Argument(help="Campaign.", metavar="CAMPAIGN.csv")],
    model: Annotated[
        Path | None,
        typer.Option(help="Model file, where the columns alone do not tell the machine's axes."),
    ] = None,
    as_json: AsJson = False,
    report: Report = None,
    force: Force = False,
) -> None:
    """Evaluate positioning runs, circles and diagonals by ISO 230-2, ISO 230-4 and ISO 230-6."""
    from abbe.compcore.files.model_file import load_model
    from abbe.daemon.answers.measurements import iso230 as analysis
    from abbe.daemon.outputs import REPORT, check_outputs

    say = check_outputs([campaign, model], [(report, REPORT)], force=force, as_json=as_json)
    machine = None if model is None else load_model(model).machine
    evaluation = analysis.evaluate(campaign, machine)
    if report is not None:
        from abbe.daemon.report.measurements.iso230 import page

        page(evaluation).write(report)
    if as_json:
        say(json.dumps(analysis.as_json(evaluation), ensure_ascii=False))
        return
    for line in analysis.as_text(evaluation):
        say(line)
