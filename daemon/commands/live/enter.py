"""``abbe enter``: a value that no sensor reads, for a running correction."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from abbe.daemon.arguments.options import AsJson, ConfigFile


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("enter")(enter)


def enter(
    config: ConfigFile,
    assignment: Annotated[
        str | None, typer.Argument(help="What was read.", metavar="SIGNAL=VALUE")
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option("--for", help="s for which it counts; default as configured.", metavar="S"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Type in a value that a person has read; without one, show all.

    An example: abbe enter config.toml T_workpiece=23.4 --for 3600
    """
    from abbe.daemon.arguments.bounded import within
    from abbe.daemon.arguments.live.running import asked, one_assignment
    from abbe.daemon.control.requests import EnterRequest, StateRequest

    if assignment is None:
        answer = asked(config, StateRequest())
    else:
        if seconds is not None:
            within(1e-3, 1e7, "s")(seconds)
        name, value = one_assignment(assignment, "a number in the signal's own unit")
        answer = asked(config, EnterRequest(signal=name, value=value, seconds=seconds))
    if as_json:
        typer.echo(json.dumps(answer, ensure_ascii=False))
        return
    if assignment is not None:
        typer.echo(answer["said"])
        return
    for name, found in answer["entered"].items():
        shown = "–" if found["value"] is None else f"{found['value']:g} {found['unit']}"
        age = "" if found["age_s"] is None else f", {found['age_s']:g} s ago"
        fault = f": {found['fault']}" if found["fault"] else ""
        typer.echo(f"{name} {shown}{age}{fault}")
