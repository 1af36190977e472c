"""``abbe compare``: a model beside measurements, nothing fitted but the placing of instruments."""

from __future__ import annotations

import json
from dataclasses import replace

import typer

from abbe.daemon.arguments.options import (
    ActiveModel,
    AsJson,
    CampaignFiles,
    Force,
    ModelFile,
    Report,
)


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("compare")(compare)


def compare(
    model: ModelFile,
    campaigns: CampaignFiles,
    active: ActiveModel = None,
    as_json: AsJson = False,
    report: Report = None,
    force: Force = False,
) -> None:
    """Lay a model beside campaigns: how large is what it does not explain, and where."""
    from abbe.compcore.comparison.compare import compare as compare_model
    from abbe.daemon.answers.inputs import load
    from abbe.daemon.answers.model import compare as answer
    from abbe.daemon.answers.model import expected_times as expected
    from abbe.daemon.answers.typed import diagnosing
    from abbe.daemon.outputs import REPORT, check_outputs
    from abbe.daemon.progress import shown

    say = check_outputs(
        [model, *campaigns, active], [(report, REPORT)], force=force, as_json=as_json
    )
    with shown("reading", expected.comparing(campaigns)) as tell:
        loaded, campaign = load(model, campaigns, active)
        tell("comparing")
        comparison = compare_model(loaded, campaign)
        tell("whether it holds")
        comparison = replace(
            answer.with_changes(loaded, campaign, comparison),
            diagnosing=diagnosing(model, campaigns),
        )
        if report is not None:
            from abbe.daemon.report.head import file_on_page, head_of
            from abbe.daemon.report.model.compare import comparison_page

            tell("drawing")
            head = head_of(loaded, [file_on_page("model", model)], campaign)
            comparison_page(comparison, head).write(report)
    if as_json:
        reported = {**answer.as_json(comparison), "fitted_to": list(comparison.fitted_files)}
        say(json.dumps(reported, ensure_ascii=False))
        return
    say(comparison.report())
    if report is not None:
        say(f"written: {report}")
