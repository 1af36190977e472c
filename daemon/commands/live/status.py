"""``abbe status``: what a correction that runs says of itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("status")(status)


def status(
    config: Annotated[
        Path | None,
        typer.Argument(help="Of which run; default: all of them.", metavar="[CONFIG.toml]"),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="One JSON object; a list of them without CONFIG.")
    ] = False,
) -> None:
    """What a correction that runs says of itself; without a configuration, every run.

    An example: abbe status config.toml
    """
    from abbe.daemon.answers.status import every_run, the_run
    from abbe.daemon.status.text import lines, summary

    if config is not None:
        found = the_run(config)
        if as_json:
            typer.echo(json.dumps(found.model_dump(mode="json"), ensure_ascii=False))
            return
        for line in lines(found):
            typer.echo(line)
        return
    runs, silent = every_run()
    if as_json:
        typer.echo(json.dumps([r.model_dump(mode="json") for r in runs], ensure_ascii=False))
        return
    if len(runs) == 1:
        for line in lines(runs[0]):
            typer.echo(line)
    else:
        for run in runs:
            typer.echo(summary(run))
    for line in silent:
        typer.echo(line)
    if not runs and not silent:
        typer.echo("no correction runs on this computer")
