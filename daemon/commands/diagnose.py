"""``abbe diagnose``: which physical effect a model lacks, or that it lacks none."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.force import Force


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("diagnose")(diagnose)


def diagnose(
    model: Annotated[Path, typer.Argument(help="Model file.", metavar="MODEL.toml")],
    campaigns: Annotated[list[Path], typer.Argument(help="Campaigns.", metavar="CAMPAIGN.csv")],
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
    report: Annotated[
        Path | None,
        typer.Option("--report", help="A page that tells the story.", metavar="FILE.html"),
    ] = None,
    force: Force = False,
) -> None:
    """Learn what is missing: every effect of the catalogue is tested against what is left over."""
    from abbe.compcore.campaign.noise import noise_floor
    from abbe.compcore.diagnosis import advise
    from abbe.compcore.diagnosis import diagnose as diagnose_model
    from abbe.daemon.answers import diagnose as answer
    from abbe.daemon.answers import expected_times as expected
    from abbe.daemon.answers.inputs import load
    from abbe.daemon.outputs import REPORT, check_outputs
    from abbe.daemon.progress import shown

    say = check_outputs([model, *campaigns], [(report, REPORT)], force=force, as_json=as_json)
    with shown("reading", expected.diagnosing(campaigns)) as tell:
        loaded, campaign = load(model, campaigns)
        found = diagnose_model(loaded, campaign, progress=tell)
        tell("what to measure next")
        advice = advise(found)
        tell("noise floor")
        noise = noise_floor(campaign, loaded.machine)
    if report is not None:
        from abbe.daemon.report.diagnosis import page

        subtitle = f"{model.name}, {', '.join(c.name for c in campaigns)}"
        page(found, noise, advice, subtitle).write(report)
    if as_json:
        say(json.dumps(answer.as_json(found, noise, advice), ensure_ascii=False))
        return
    for line in answer.as_text(found, noise, advice):
        say(line)
    if report is not None:
        say(f"written: {report}")
