"""``abbe add``: one more effect, refitted; the error before and after, also on unseen campaigns."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from abbe.daemon.arguments.force import Force
from abbe.daemon.arguments.lists import ListOptions


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("add", cls=ListOptions)(add)


def add(
    model: Annotated[Path, typer.Argument(help="Model file.", metavar="MODEL.toml")],
    kind: Annotated[str, typer.Argument(help="Kind of effect, see 'abbe effects'.")],
    campaign: Annotated[
        list[Path], typer.Option("--campaign", help="Campaigns to fit, one or more.")
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="The next version of the model.")],
    keys: Annotated[
        list[str] | None, typer.Argument(help="KEY=VALUE as 'abbe diagnose' prints them.")
    ] = None,
    holdout: Annotated[
        list[Path] | None,
        typer.Option("--holdout", help="Campaigns that are not fitted, to see the error fall."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
    report: Annotated[
        Path | None,
        typer.Option(help="A page with the error, version by version.", metavar="FILE.html"),
    ] = None,
    force: Force = False,
) -> None:
    """Add an effect to a model, refit, and watch the error fall."""
    from abbe.compcore.model.revise import with_effect
    from abbe.daemon.answers.inputs import load
    from abbe.daemon.answers.model import expected_times as expected
    from abbe.daemon.answers.model import revise as answer
    from abbe.daemon.arguments.assignments import split_assignments
    from abbe.daemon.outputs import MODEL, REPORT, check_outputs
    from abbe.daemon.progress import shown
    from abbe.daemon.report.model.history import page_of

    say = check_outputs(
        [model, *campaign, *(holdout or [])],
        [(out, MODEL), (report, REPORT)],
        force=force,
        as_json=as_json,
    )
    # a whole spec in one pair of quotes is what 'abbe diagnose' prints, too
    name, *more_keys = kind.split() or [kind]
    with shown("reading", expected.adding(campaign)) as tell:
        loaded, measured = load(model, campaign)
        assigned = split_assignments([*more_keys, *(keys or [])])
        more, effect = with_effect(loaded, name, assigned)
        revision = answer.revise(
            loaded, more, measured, holdout or [], out, added=effect.spec, progress=tell
        )
    if report is not None:
        page_of(revision.model, out).write(report)
    if as_json:
        say(json.dumps(answer.as_json(revision, effect), ensure_ascii=False))
        return
    for line in answer.as_text(revision, effect):
        say(line)
    say(f"written: {out}" + (f", {report}" if report else ""))
