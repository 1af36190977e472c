"""``abbe remove``: one effect less; refitted where campaigns are given."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.force import Force
from abbe.daemon.arguments.lists import ListOptions


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("remove", cls=ListOptions)(remove)


def remove(
    model: Annotated[Path, typer.Argument(help="Model file.", metavar="MODEL.toml")],
    effect: Annotated[list[str], typer.Argument(help="The effect, as 'abbe history' names it.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="The next version of the model.")],
    campaign: Annotated[
        list[Path] | None, typer.Option("--campaign", help="Campaigns to refit what is left.")
    ] = None,
    holdout: Annotated[
        list[Path] | None, typer.Option("--holdout", help="Campaigns that are not fitted.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
    report: Annotated[
        Path | None,
        typer.Option(help="A page with the error, version by version.", metavar="FILE.html"),
    ] = None,
    force: Force = False,
) -> None:
    """Take an effect out of a model; the others keep their values unless campaigns are given."""
    from abbe.compcore.files.model_file import load_model, save_model
    from abbe.compcore.model.revise import without_effect
    from abbe.daemon.answers.inputs import load
    from abbe.daemon.answers.model import expected_times as expected
    from abbe.daemon.answers.model import revise as answer
    from abbe.daemon.answers.typed import fitting
    from abbe.daemon.outputs import MODEL, REPORT, check_outputs
    from abbe.daemon.progress import shown
    from abbe.daemon.report.model.history import page_of

    name = " ".join(effect)
    say = check_outputs(
        [model, *(campaign or []), *(holdout or [])],
        [(out, MODEL), (report, REPORT)],
        force=force,
        as_json=as_json,
    )
    if not campaign:
        loaded = load_model(model)
        less, removed = without_effect(loaded, name)
        kept = answer.unfitted(loaded, less, removed=removed.spec)
        save_model(kept, out)
        if report is not None:
            page_of(kept, out).write(report)
        if as_json:
            say(json.dumps({"removed": removed.spec, "refitted": False}))
        else:
            say(f"removed: {removed.spec}; the other effects keep their values")
            say(f"refit them, or give --campaign: {fitting(out)}")
            say(f"written: {out}" + (f", {report}" if report else ""))
        return
    with shown("reading", expected.adding(campaign)) as tell:
        loaded, measured = load(model, campaign)
        less, removed = without_effect(loaded, name)
        revision = answer.revise(
            loaded, less, measured, holdout or [], out, removed=removed.spec, progress=tell
        )
    if report is not None:
        page_of(revision.model, out).write(report)
    if as_json:
        say(json.dumps(answer.as_json(revision, None), ensure_ascii=False))
        return
    say(f"removed: {removed.spec}")
    for line in answer.as_text(revision, None):
        say(line)
    say(f"written: {out}" + (f", {report}" if report else ""))
