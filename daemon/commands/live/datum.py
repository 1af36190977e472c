"""``abbe datum``: where an axis stands whose encoder does not know, for a running correction."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from abbe.daemon.arguments.options import AsJson, ConfigFile


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("datum")(datum)


def datum(
    config: ConfigFile,
    assignment: Annotated[
        str | None,
        typer.Argument(help="Where it stands, mm (rotary: degrees).", metavar="AXIS=POSITION"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say where an axis stands that is at its reference; without one, show all.

    An example: abbe datum config.toml X=0
    """
    from abbe.daemon.arguments.live.running import asked, one_assignment
    from abbe.daemon.control.requests import DatumRequest, StateRequest

    if assignment is None:
        answer = asked(config, StateRequest())
    else:
        name, value = one_assignment(assignment, "mm, or degrees of a rotary axis")
        answer = asked(config, DatumRequest(axis=name, position=value))
    if as_json:
        typer.echo(json.dumps(answer, ensure_ascii=False))
        return
    if assignment is not None:
        typer.echo(answer["said"])
        return
    for axis, problem in answer["datums"].items():
        typer.echo(f"{axis}: {problem or 'set'}")
